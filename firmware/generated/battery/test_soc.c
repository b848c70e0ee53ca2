/* Replays the vectors: every output must have the very bits of the reference. Exit status 0 if so. */
#include "soc.h"
#include "soc_vectors.h"

#include <math.h>
#include <stdio.h>

int main(void)
{
    static soc_state state;
    static soc_sample sample;
    static soc_output output;
    unsigned wrong = 0;

    soc_vector(0, &sample);
    soc_start(&state, &sample, 0.5f, 0.3f);
    for (unsigned t = 0; t < SOC_VECTORS; ++t) {
        soc_vector(t, &sample);
        soc_step(&state, &sample, &output);
        if (!soc_is_right(t, &output)) {
            printf("soc: vector %u is wrong\n", t);
            ++wrong;
        }
    }
    printf("soc: %u of %u vectors right to the last bit\n", SOC_VECTORS - wrong, (unsigned)SOC_VECTORS);
    return wrong ? 1 : 0;
}
