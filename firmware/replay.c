/* Replays the vectors of an exported filter: bits, time of each step in ticks, depth of the stack. */
#include "board.h"
#include "filter.h"
#include "filter_vectors.h"

int main(void)
{
    static filter_state state;
    static filter_sample sample;
    static filter_output output;
    uint32_t wrong = 0, least = 0xFFFFFFFFu, most = 0, total = 0;

    clock_start();
    filter_vector(0, &sample);
    filter_start(&state, &sample START_ARGUMENTS);
    stack_paint();
    const uint32_t free_before = stack_left();
    for (unsigned t = 0; t < FILTER_VECTORS; ++t) {
        filter_vector(t, &sample);
        const uint32_t before = clock_now();
        filter_step(&state, &sample, &output);
        const uint32_t taken = (clock_now() - before) & 0xFFFFFFu;
        least = taken < least ? taken : least;
        most = taken > most ? taken : most;
        total += taken;
        wrong += filter_is_right(t, &output) ? 0u : 1u;
    }
    say_number("vectors", FILTER_VECTORS);
    say_number("wrong", wrong);
    say_number("least", least);
    say_number("most", most);
    say_number("total", total);
    say_number("stack", free_before - stack_left());
    return wrong ? 1 : 0;
}
