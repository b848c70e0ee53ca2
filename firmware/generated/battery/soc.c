#include "soc.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

/* OcvCurve.mean_V (battery/models/ocv.py) */
static const float soc_table0[202] = {
    10.0f, 10.4f, 10.8f, 11.2f, 11.5f, 11.8f, 11.913333f, 12.026667f, 12.14f, 12.253333f, 12.366667f, 12.48f,
    12.512f, 12.544f, 12.576f, 12.608f, 12.64f, 12.672f, 12.704f, 12.736f, 12.768f, 12.8f, 12.808f, 12.816f,
    12.824f, 12.832f, 12.84f, 12.848f, 12.856f, 12.864f, 12.872f, 12.88f, 12.892f, 12.904f, 12.916f, 12.928f,
    12.94f, 12.952f, 12.964f, 12.976f, 12.988f, 13.0f, 13.006f, 13.012f, 13.018f, 13.024f, 13.03f, 13.036f,
    13.042f, 13.048f, 13.054f, 13.06f, 13.066f, 13.072f, 13.078f, 13.084f, 13.09f, 13.096f, 13.102f, 13.108f,
    13.114f, 13.12f, 13.122f, 13.124f, 13.126f, 13.128f, 13.13f, 13.132f, 13.134f, 13.136f, 13.138f, 13.14f,
    13.142f, 13.144f, 13.146f, 13.148f, 13.15f, 13.152f, 13.154f, 13.156f, 13.158f, 13.16f, 13.161f, 13.162f,
    13.163f, 13.164f, 13.165f, 13.166f, 13.167f, 13.168f, 13.169f, 13.17f, 13.171f, 13.172f, 13.173f, 13.174f,
    13.175f, 13.176f, 13.177f, 13.178f, 13.179f, 13.18f, 13.181f, 13.182f, 13.183f, 13.184f, 13.185f, 13.186f,
    13.187f, 13.188f, 13.189f, 13.19f, 13.191f, 13.192f, 13.193f, 13.194f, 13.195f, 13.196f, 13.197f, 13.198f,
    13.199f, 13.2f, 13.204f, 13.208f, 13.212f, 13.216f, 13.22f, 13.224f, 13.228f, 13.232f, 13.236f, 13.24f,
    13.246f, 13.252f, 13.258f, 13.264f, 13.27f, 13.276f, 13.282f, 13.288f, 13.294f, 13.3f, 13.301f, 13.302f,
    13.303f, 13.304f, 13.305f, 13.306f, 13.307f, 13.308f, 13.309f, 13.31f, 13.311f, 13.312f, 13.313f, 13.314f,
    13.315f, 13.316f, 13.317f, 13.318f, 13.319f, 13.32f, 13.321f, 13.322f, 13.323f, 13.324f, 13.325f, 13.326f,
    13.327f, 13.328f, 13.329f, 13.33f, 13.331f, 13.332f, 13.333f, 13.334f, 13.335f, 13.336f, 13.337f, 13.338f,
    13.339f, 13.34f, 13.343333f, 13.346666f, 13.35f, 13.353333f, 13.356667f, 13.36f, 13.363334f, 13.366667f,
    13.37f, 13.373333f, 13.376667f, 13.38f, 13.395f, 13.41f, 13.425f, 13.44f, 13.58f, 13.72f, 13.86f, 14.0f
};
/* OcvCurve.mean_V (battery/models/ocv.py) */
static const float soc_table1[202] = {
    0.4f, 0.4f, 0.4f, 0.34285715f, 0.3f, 0.16451614f, 0.11333334f, 0.11333334f, 0.11333334f, 0.11333334f,
    0.11333334f, 0.049908258f, 0.032f, 0.032f, 0.032f, 0.032f, 0.032f, 0.032f, 0.032f, 0.032f, 0.032f,
    0.0128f, 0.008f, 0.008f, 0.008f, 0.008f, 0.008f, 0.008f, 0.008f, 0.008f, 0.008f, 0.0096f, 0.012f, 0.012f,
    0.012f, 0.012f, 0.012f, 0.012f, 0.012f, 0.012f, 0.012f, 0.008f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f,
    0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f,
    0.006f, 0.003f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f,
    0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.002f, 0.0013333333f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.0016f, 0.004f, 0.004f,
    0.004f, 0.004f, 0.004f, 0.004f, 0.004f, 0.004f, 0.004f, 0.0048f, 0.006f, 0.006f, 0.006f, 0.006f, 0.006f,
    0.006f, 0.006f, 0.006f, 0.006f, 0.0017142857f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f,
    0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.001f, 0.0015384615f, 0.0033333334f, 0.0033333334f,
    0.0033333334f, 0.0033333334f, 0.0033333334f, 0.0033333334f, 0.0033333334f, 0.0033333334f, 0.0033333334f,
    0.0033333334f, 0.0033333334f, 0.0054545454f, 0.015f, 0.015f, 0.015f, 0.027096774f, 0.14f, 0.14f, 0.14f,
    0.14f
};
/* OcvCurve.mean_V (battery/models/ocv.py) */
static const float soc_table2[202] = {
    0.0f, 0.0f, 0.057142857f, (-0.08571429f), 0.13548388f, (-0.10236559f), 0.0f, 0.0f, 0.0f, 0.0f,
    0.06342508f, (-0.035816513f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0192f, (-0.0096f), 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.0016f), 0.0048f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.004f, (-0.004f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.003f, (-0.002f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.00066666666f, (-0.00066666666f), 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, (-0.0006f), 0.0048f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.0008f), 0.0024f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.004285714f, (-0.0014285714f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    (-0.00053846155f), 0.0035897435f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    (-0.0021212122f), 0.01909091f, 0.0f, 0.0f, (-0.012096774f), 0.22580644f, 0.0f, 0.0f, 0.0f, 0.0f
};
/* OcvCurve.mean_V (battery/models/ocv.py) */
static const float soc_table3[202] = {
    0.0f, 0.0f, (-0.057142857f), 0.042857144f, (-0.13548388f), 0.051182795f, 0.0f, 0.0f, 0.0f, 0.0f,
    (-0.06342508f), 0.017908257f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.0192f), 0.0048f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0016f, (-0.0024f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, (-0.004f), 0.002f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.003f), 0.001f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.00066666666f), 0.00033333333f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0006f, (-0.0024f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0008f, (-0.0012f), 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, (-0.004285714f), 0.0007142857f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.00053846155f, (-0.0017948718f), 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f,
    0.0021212122f, (-0.009545455f), 0.0f, 0.0f, 0.012096774f, (-0.11290322f), 0.0f, 0.0f, 0.0f, 0.0f
};

void soc_start(soc_state *state, const soc_sample *sample, float soc, float soc_std)
{
    const float current_A = sample->current_A;
    /* within (filters/sanitize.py): True where a value is a number of at most this size */
    const bool credible = fabsf(current_A) <= 1e+09f;
    /* hold (filters/sanitize.py): The value where it is credible, else the last credible one */
    const float current_A2 = credible ? current_A : 0.0f;
    state->current_A = current_A2;
    /* TextbookFilter.start (battery/soc/textbook.py): State before the first sample at the given SoC, unchecked
       by its voltage */
    const float t2 = fabsf(current_A2);
    const float std_1 = 0.001f + 0.01f * t2;
    const float std_2 = 0.001f + 0.033333335f * t2;
    state->belief_lower[0] = soc_std * soc_std;
    state->belief_lower[2] = std_1 * std_1;
    state->belief_lower[5] = std_2 * std_2;
    state->belief_mean[0] = soc;
    state->belief_mean[1] = 0.0f;
    state->belief_mean[2] = 0.0f;
    state->belief_lower[1] = 0.0f;
    state->belief_lower[3] = 0.0f;
    state->belief_lower[4] = 0.0f;
}

void soc_step(soc_state *state, const soc_sample *sample, soc_output *output)
{
    const float belief_mean_0 = state->belief_mean[0];
    const float belief_mean_1 = state->belief_mean[1];
    const float belief_mean_2 = state->belief_mean[2];
    const float belief_lower_0 = state->belief_lower[0];
    const float belief_lower_1 = state->belief_lower[1];
    const float belief_lower_2 = state->belief_lower[2];
    const float belief_lower_3 = state->belief_lower[3];
    const float belief_lower_4 = state->belief_lower[4];
    const float belief_lower_5 = state->belief_lower[5];
    const float current_A = state->current_A;
    const float current_A2 = sample->current_A;
    const float voltage_V = sample->voltage_V;
    /* within (filters/sanitize.py): True where a value is a number of at most this size */
    const bool credible = fabsf(current_A2) <= 1e+09f;
    /* hold (filters/sanitize.py): The value where it is credible, else the last credible one */
    const float current_A3 = credible ? current_A2 : current_A;
    state->current_A = current_A3;
    /* is_voltage (battery/soc/clean_sample.py): True where it is a number and a battery with these open-circuit
       voltages, empty and full, can show it */
    const bool measured = (0.0f < voltage_V) && (voltage_V < 19.6f);
    /* sanitize_bare (battery/soc/clean_sample.py): The sample with an impossible current, step or voltage
       replaced */
    const float clean_mean_A = 0.5f * (current_A + current_A3);
    const float clean_voltage_V = measured ? voltage_V : 0.0f;
    /* TextbookFilter.predict (battery/soc/textbook.py): The belief after `dt_s` of a constant current */
    const float driven_0 = 0.00048770575f * clean_mean_A;
    const float driven_1 = 2.2214817e-05f * clean_mean_A;
    const float moved = 2.3148148e-05f * clean_mean_A;
    /* predict (filters/kalman.py): Belief after one step of x+ = F x + offset + w, w ~ N(0, Q) */
    const float prior_mean_0 = belief_mean_0 + moved;
    const float prior_mean_1 = driven_0 + 0.95122945f * belief_mean_1;
    const float prior_mean_2 = driven_1 + 0.99933356f * belief_mean_2;
    const float prior_cov_0_1 = 0.95122945f * belief_lower_1;
    const float prior_cov_0_2 = 0.99933356f * belief_lower_3;
    const float prior_cov_1_2 = 0.95122945f * (0.99933356f * belief_lower_4);
    const float prior_cov_0_0 = 3.0864197e-13f + belief_lower_0;
    const float prior_cov_1_1 = 3.6e-07f + 0.95122945f * (0.95122945f * belief_lower_2);
    const float prior_cov_2_2 = 4e-06f + 0.99933356f * (0.99933356f * belief_lower_5);
    /* ohmic_drop (battery/models/thevenin.py): Ohmic drop [V] */
    const float linear_V = 0.016666668f * current_A3;
    /* cholesky (filters/linear_algebra.py): Lower factor L of scale^2 P = L L', guarded */
    const float floor2 = 1.1754944e-38f + 1e-14f * fabsf(prior_cov_0_0);
    const float d = (prior_cov_0_0 < floor2) ? floor2 : prior_cov_0_0;
    const float root = 1.4722432f * sqrtf(d);
    /* OcvCurve.mean_V (battery/models/ocv.py): Mean of both branches [V] at soc, float, array or traced */
    const float u = 1.0f + 200.0f * prior_mean_0;
    const float t2 = (0.0f < u) ? u : 0.0f;
    const float t3 = (t2 >= 201.0f) ? 201.0f : t2;
    const int32_t i0 = (int32_t)t3;
    const float segment = (float)i0;
    const float t4 = u - segment;
    const float lower_0 = soc_table0[i0];
    const float lower_1 = soc_table1[i0];
    const float lower_2 = soc_table2[i0];
    const float y = lower_0 + t4 * (lower_1 + t4 * (lower_2 + t4 * soc_table3[i0]));
    /* TextbookFilter.curve_V (battery/soc/textbook.py): Terminal voltage [V] without the RC voltages */
    const float middle_0 = linear_V + y;
    /* correct (filters/conditionally_linear.py): Belief after y = g(x_1 ... x_k) + H x + v, v ~ N(0, R), with the
       innovation and the gain */
    const float x = prior_mean_0 + root;
    /* OcvCurve.mean_V */
    const float u2 = 1.0f + 200.0f * x;
    const float t5 = (0.0f < u2) ? u2 : 0.0f;
    const float t6 = (t5 >= 201.0f) ? 201.0f : t5;
    const int32_t i1 = (int32_t)t6;
    const float segment2 = (float)i1;
    const float t7 = u2 - segment2;
    const float lower_0_2 = soc_table0[i1];
    const float lower_1_2 = soc_table1[i1];
    const float lower_2_2 = soc_table2[i1];
    const float y2 = lower_0_2 + t7 * (lower_1_2 + t7 * (lower_2_2 + t7 * soc_table3[i1]));
    /* TextbookFilter.curve_V */
    const float plus_0_0 = linear_V + y2;
    /* correct */
    const float x2 = prior_mean_0 - root;
    /* OcvCurve.mean_V */
    const float u3 = 1.0f + 200.0f * x2;
    const float t8 = (0.0f < u3) ? u3 : 0.0f;
    const float t9 = (t8 >= 201.0f) ? 201.0f : t8;
    const int32_t i2 = (int32_t)t9;
    const float segment3 = (float)i2;
    const float t10 = u3 - segment3;
    const float lower_0_3 = soc_table0[i2];
    const float lower_1_3 = soc_table1[i2];
    const float lower_2_3 = soc_table2[i2];
    const float y3 = lower_0_3 + t10 * (lower_1_3 + t10 * (lower_2_3 + t10 * soc_table3[i2]));
    /* TextbookFilter.curve_V */
    const float minus_0_0 = linear_V + y3;
    /* correct */
    const float second_0_0 = plus_0_0 + minus_0_0 - 2.0f * middle_0;
    const float b_0 = 0.23068051f * second_0_0;
    const float L_0_0 = 2.0f * root;
    const float B_0_0 = plus_0_0 - minus_0_0;
    /* solve_lower (filters/linear_algebra.py): Solve L X = B by forward substitution */
    const float rows_0_0 = B_0_0 / L_0_0;
    /* correct */
    const float t11 = 0.115340255f * (second_0_0 * second_0_0) + 1.2775f * (b_0 * b_0);
    const float R_eff_0_0 = 1.0004f + t11;
    const float y_hat_0 = middle_0 + b_0 + (prior_mean_1 + prior_mean_2);
    /* correct (filters/kalman.py): `update`, with the gain too */
    const float C_0_0 = prior_cov_0_2 + (prior_cov_0_1 + prior_cov_0_0 * rows_0_0);
    const float C_1_0 = prior_cov_1_2 + (prior_cov_1_1 + prior_cov_0_1 * rows_0_0);
    const float C_2_0 = prior_cov_2_2 + (prior_cov_1_2 + prior_cov_0_2 * rows_0_0);
    const float innovation_cov_0_0 = R_eff_0_0 + (C_2_0 + (C_1_0 + rows_0_0 * C_0_0));
    /* gain (filters/kalman.py): K = C S^-1 (n, m) from the covariance C (n, m) of state and output and S (m, m)
       of the innovation */
    const float t12 = (innovation_cov_0_0 <= 1.1754944e-38f) ? 1.1754944e-38f : innovation_cov_0_0;
    const float t13 = measured ? 1.0f / t12 : 0.0f;
    const float K_0_0 = C_0_0 * t13;
    const float K_1_0 = C_1_0 * t13;
    const float K_2_0 = C_2_0 * t13;
    /* correct */
    const float innovation_value_0 = clean_voltage_V - y_hat_0;
    const float posterior_mean_0 = prior_mean_0 + K_0_0 * innovation_value_0;
    state->belief_mean[0] = posterior_mean_0;
    state->belief_mean[1] = prior_mean_1 + K_1_0 * innovation_value_0;
    state->belief_mean[2] = prior_mean_2 + K_2_0 * innovation_value_0;
    /* joseph (filters/kalman.py): (I - K H) P (I - K H)' + K R K' (n, n), for any gain K */
    const float M_0_0 = prior_cov_0_0 - C_0_0 * K_0_0;
    const float M_0_1 = prior_cov_0_1 - C_1_0 * K_0_0;
    const float M_0_2 = prior_cov_0_2 - C_2_0 * K_0_0;
    const float M_1_0 = prior_cov_0_1 - C_0_0 * K_1_0;
    const float M_1_1 = prior_cov_1_1 - C_1_0 * K_1_0;
    const float M_1_2 = prior_cov_1_2 - C_2_0 * K_1_0;
    const float M_2_0 = prior_cov_0_2 - C_0_0 * K_2_0;
    const float M_2_1 = prior_cov_1_2 - C_1_0 * K_2_0;
    const float M_2_2 = prior_cov_2_2 - C_2_0 * K_2_0;
    const float t14 = M_1_2 + (M_1_1 + rows_0_0 * M_1_0) - R_eff_0_0 * K_1_0;
    const float t15 = M_2_2 + (M_2_1 + rows_0_0 * M_2_0) - R_eff_0_0 * K_2_0;
    const float t16 = K_0_0 * (M_0_2 + (M_0_1 + rows_0_0 * M_0_0) - R_eff_0_0 * K_0_0);
    const float posterior_cov_0_0 = M_0_0 - t16;
    state->belief_lower[0] = posterior_cov_0_0;
    state->belief_lower[1] = M_1_0 - K_0_0 * t14;
    state->belief_lower[2] = M_1_1 - K_1_0 * t14;
    state->belief_lower[3] = M_2_0 - K_0_0 * t15;
    state->belief_lower[4] = M_2_1 - K_1_0 * t15;
    state->belief_lower[5] = M_2_2 - K_2_0 * t15;
    /* TextbookFilter.estimate (battery/soc/textbook.py): Estimate after a sample, from SoC and its variance, the
       innovation [V] and its variance [V^2] */
    const float t17 = (posterior_mean_0 <= 0.0f) ? 0.0f : posterior_mean_0;
    output->soc = (t17 >= 1.0f) ? 1.0f : t17;
    const float estimate_soc_std = sqrtf((posterior_cov_0_0 <= 0.0f) ? 0.0f : posterior_cov_0_0);
    output->soc_std = estimate_soc_std;
    output->voltage_V = clean_voltage_V - innovation_value_0;
    output->voltage_std_V = sqrtf(innovation_cov_0_0);
    output->innovation_V = measured ? innovation_value_0 : NAN;
    /* flags_of (filters/flags.py): Sum of the flags whose condition holds, as a float */
    output->flags = measured ? 0.0f : 2.0f;
    output->current_offset_A = NAN;
    output->current_offset_std_A = NAN;
    output->soh_capacity = NAN;
    output->soh_capacity_std = NAN;
    output->resistance_ratio = NAN;
    output->resistance_ratio_std = NAN;
}
