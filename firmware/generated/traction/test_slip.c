/* Replays the vectors: every output must have the very bits of the reference. Exit status 0 if so. */
#include "slip.h"
#include "slip_vectors.h"

#include <math.h>
#include <stdio.h>

int main(void)
{
    static slip_state state;
    static slip_sample sample;
    static slip_output output;
    unsigned wrong = 0;

    slip_vector(0, &sample);
    slip_start(&state, &sample);
    for (unsigned t = 0; t < SLIP_VECTORS; ++t) {
        slip_vector(t, &sample);
        slip_step(&state, &sample, &output);
        if (!slip_is_right(t, &output)) {
            printf("slip: vector %u is wrong\n", t);
            ++wrong;
        }
    }
    printf("slip: %u of %u vectors right to the last bit\n", SLIP_VECTORS - wrong, (unsigned)SLIP_VECTORS);
    return wrong ? 1 : 0;
}
