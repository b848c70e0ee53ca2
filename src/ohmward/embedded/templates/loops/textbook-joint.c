enum { N = @N@, PARAMETERS = @PARAMETERS@, MOVED = N - PARAMETERS };

static const float @NAME@_walk[N] = {@WALK@};

/* A row for each state. `odd`: offset of sigma point k from the mean, later the difference of the images of its pair.
   `even`: sum of the images of a pair minus twice the mean, last that of the central point; parameters have none. */
typedef struct {
    float odd[N][N], even[MOVED][N + 1];
} @NAME@_points;

/* Offsets of the sigma points: the lower factor of c P, no pivot below a floor. */
static void @NAME@_draw(const float *lower, @NAME@_points *points)
{
    float u[N][N], v[N][N]; /* P = U D U', V = U D */
    for (int j = 0; j < N; ++j) {
        float reciprocal = 0.0f, root = 0.0f;
        const float *p = lower + j;
        lower += j + 1;
        for (int i = j; i < N; ++i) {
            float left = *p;
            for (int k = 0; k < j; ++k) {
                left -= u[i][k] * v[j][k];
            }
            if (i == j) {
                const float floor = @PIVOT_FLOOR@ * fabsf(*p) + @TINY@;
                const float d = left < floor ? floor : left;
                reciprocal = 1.0f / d;
                root = @SCALE@ * sqrtf(d);
            }
            v[i][j] = left;
            u[i][j] = left * reciprocal;
            points->odd[j][i] = 0.0f;
            points->odd[i][j] = i == j ? root : left * (root * reciprocal);
            p += i + 1;
        }
    }
}

/* The points through the model; the mean becomes that of their images. */
static void @NAME@_propagate(float *mean, const @NAME@_clean *clean, @NAME@_points *points)
{
    float y[3][MOVED];
    @NAME@_move(mean, clean, y[2]);
    for (int k = 0; k < N; ++k) {
        for (int s = 0; s < 2; ++s) {
            float point[N];
            for (int i = 0; i < N; ++i) {
                point[i] = s ? mean[i] - points->odd[i][k] : mean[i] + points->odd[i][k];
            }
            @NAME@_move(point, clean, y[s]);
        }
        for (int i = 0; i < MOVED; ++i) {
            points->odd[PARAMETERS + i][k] = y[0][i] - y[1][i];
            points->even[i][k] = y[0][i] + y[1][i];
        }
    }
    for (int i = 0; i < MOVED; ++i) {
        float *const even = points->even[i], sum = 0.0f;
        for (int k = 0; k < N; ++k) {
            sum += even[k];
        }
        const float m = @MEAN_0@ * y[2][i] + @SIDE@ * sum;
        for (int k = 0; k < N; ++k) {
            even[k] -= 2.0f * m;
        }
        even[N] = @CENTRE@ * (y[2][i] - m);
        mean[PARAMETERS + i] = m;
    }
}

static float @NAME@_dot(const float *a, const float *b, int count)
{
    float sum = 0.0f;
    for (int k = 0; k < count; ++k) {
        sum += a[k] * b[k];
    }
    return sum;
}

/* Covariance of the images of a moved state i and of state j; the images of a parameter differ by twice its offset. */
static float @NAME@_covariance(const @NAME@_points *points, int i, int j)
{
    float sum = @NAME@_dot(points->odd[i], points->odd[j], N);
    sum += j < PARAMETERS ? sum : @NAME@_dot(points->even[i - PARAMETERS], points->even[j - PARAMETERS], N + 1);
    return @PAIR@ * sum;
}

void @NAME@_step(@NAME@_state *state, const @NAME@_sample *sample, @NAME@_output *output)
{
    float *const mean = state->belief_mean, *const gain = state->gain, *row = state->belief_lower + N * (N + 1) / 2;
    float K[N]; /* first the covariance of states and output */
    @NAME@_points points;
    @NAME@_clean clean;
    @NAME@_sanitize(state, sample, &clean);
    @NAME@_draw(state->belief_lower, &points);
    @NAME@_propagate(mean, &clean, &points);

    for (int j = 0; j < N; ++j) {
        K[j] = @NAME@_covariance(&points, N - 1, j);
    }
    const float R = state->noise_residual[0] + row[-1] + @VOLTAGE_VARIANCE@;
    const float S = K[N - 1] + R, innovation = clean.voltage_V - mean[N - 1];
    const float reciprocal = 1.0f / (S <= @TINY@ ? @TINY@ : S);
    for (int i = 0; i < N; ++i) {
        K[i] = clean.measured ? K[i] * reciprocal : 0.0f;
        mean[i] += K[i] * innovation;
    }
    for (int i = N - 1; i >= 0; --i) {
        row -= i + 1;
        for (int j = 0; j <= i; ++j) {
            if (i >= PARAMETERS) {
                row[j] = @NAME@_covariance(&points, i, j);
            }
            const float Q = (i == j ? @NAME@_walk[i] : 0.0f) + state->noise_innovation[0] * (gain[i] * gain[j]);
            row[j] = row[j] + Q - K[i] * S * K[j];
        }
        gain[i] = K[i];
    }
    @NAME@_conclude(state, &clean, innovation, output);
}
