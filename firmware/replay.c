/* Replays the vectors of an exported filter, and a log of any length from a file: bits, time of each step, stack. */
#include "board.h"
#include "library.h"

enum { BLOCK = 32 };

typedef struct {
    uint32_t steps, least, most;
    uint64_t total;
} times;

static times over_vectors = {0u, 0xFFFFFFFFu, 0u, 0u}, over_log = {0u, 0xFFFFFFFFu, 0u, 0u};
static filter_state state;
static uint32_t stack_before; /* the step */

static void timed_step(const filter_sample *sample, filter_output *output, times *taken)
{
    stack_before = stack_here();
    const uint32_t before = clock_now();
    filter_step(&state, sample, output);
    const uint32_t ticks = (clock_now() - before) & 0xFFFFFFu;
    taken->least = ticks < taken->least ? ticks : taken->least;
    taken->most = ticks > taken->most ? ticks : taken->most;
    taken->total += ticks;
    ++taken->steps;
}

/* How many of the vectors have wrong bits. */
static uint32_t replay_vectors(void)
{
    static filter_sample sample;
    static filter_output output;
    uint32_t wrong = 0;

    filter_vector(0, &sample);
    filter_start(&state, &sample START_ARGUMENTS);
    for (unsigned t = 0; t < FILTER_VECTORS; ++t) {
        filter_vector(t, &sample);
        timed_step(&sample, &output, &over_vectors);
        wrong += filter_is_right(t, &output) ? 0u : 1u;
    }
    return wrong;
}

/* Structs of samples from one file, structs of outputs to another; the computer compares. */
static void replay_log(int samples_file)
{
    static filter_sample samples[BLOCK];
    static filter_output outputs[BLOCK];
    const int outputs_file = file_open("outputs.bin", FILE_WRITE);

    for (uint32_t count; (count = file_read(samples_file, samples, sizeof samples) / sizeof *samples) != 0u;) {
        if (!over_log.steps) {
            filter_start(&state, &samples[0] START_ARGUMENTS);
        }
        for (uint32_t k = 0; k < count; ++k) {
            timed_step(&samples[k], &outputs[k], &over_log);
        }
        file_write(outputs_file, outputs, count * sizeof *outputs);
    }
}

static void say_times(const times *taken, const char *const names[4])
{
    say_number(names[0], taken->steps);
    say_number(names[1], taken->least);
    say_number(names[2], taken->most);
    say_number(names[3], taken->total);
}

int main(void)
{
    static const char *const vectors[4] = {"vectors", "vectors_least", "vectors_most", "vectors_total"};
    static const char *const log[4] = {"log", "log_least", "log_most", "log_total"};

    clock_start();
    stack_paint();
    const uint32_t wrong = replay_vectors();
    const uint32_t depth = stack_before - stack_deepest(); /* before anything else is called */
    const int samples_file = file_open("samples.bin", FILE_READ);
    if (samples_file >= 0) {
        replay_log(samples_file);
    }
    say_times(&over_vectors, vectors);
    say_times(&over_log, log);
    say_number("wrong", wrong);
    say_number("stack", depth);
    return wrong ? 1 : 0;
}
