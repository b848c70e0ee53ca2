enum { N = @N@ };

void @NAME@_step(@NAME@_state *state, const @NAME@_sample *sample, @NAME@_output *output)
{
    float *const mean = state->belief_mean, *const lower = state->belief_lower;
    @NAME@_clean clean;
    @NAME@_predict(state, sample, &clean);

@LINEARISED@
    /* Row h of the output matrix; the variance R of the noise. */
    float h[N], C[N], K[N], M[N][N], S = 0.0f, v = 0.0f;
    for (int i = 0; i < N; ++i) {
        h[i] = i ? 1.0f : slope;
        v += i ? mean[i] : 0.0f;
    }
    const float innovation = clean.voltage_V - (expected + v);
    for (int i = 0; i < N; ++i) {
        C[i] = 0.0f;
        for (int j = 0; j < N; ++j) {
            M[i][j] = lower[i > j ? i * (i + 1) / 2 + j : j * (j + 1) / 2 + i];
            C[i] += M[i][j] * h[j];
        }
        S += h[i] * C[i];
    }
    S += R;

    /* The measurement; the covariance in Joseph's form. */
    const float reciprocal = clean.measured ? 1.0f / (S <= @TINY@ ? @TINY@ : S) : 0.0f;
    for (int i = 0; i < N; ++i) {
        K[i] = C[i] * reciprocal;
        mean[i] += K[i] * innovation;
    }
    for (int i = 0, at = 0; i < N; ++i) {
        float excess = 0.0f;
        for (int j = 0; j < N; ++j) {
            M[i][j] -= K[i] * C[j];
            excess += M[i][j] * h[j];
        }
        excess -= K[i] * R;
        for (int j = 0; j <= i; ++j, ++at) {
            lower[at] = M[i][j] - excess * K[j];
        }
    }
    @NAME@_conclude(state, &clean, innovation, S, output);
}
