/* Frames for the serial line to `ohmward run`.

   frame = COBS(number, sequence, time, values, crc), 0
   time and crc are 32 bit, values IEEE 754 single precision, all with the low byte first; crc is that of IEEE 802.3.
   COBS (Cheshire and Baker 1999) leaves no zero in a frame, so that a receiver finds the next one after any fault. */
#include "soc_frame.h"

#include <string.h>

typedef struct {
    uint8_t *frame;
    size_t code; /* where the length of the present block goes */
    size_t next;
    uint32_t crc;
} soc_writer;

static void soc_put(soc_writer *w, uint8_t byte)
{
    if (byte != 0u) {
        w->frame[w->next] = byte;
        w->next += 1u;
    }
    if ((byte == 0u) || ((w->next - w->code) == 255u)) {
        w->frame[w->code] = (uint8_t)(w->next - w->code);
        w->code = w->next;
        w->next += 1u;
    }
}

uint32_t soc_crc(uint32_t crc, uint8_t byte)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    const uint32_t mixed = crc ^ byte;
    const uint32_t half = (mixed >> 4) ^ table[mixed & 15u];
    return (half >> 4) ^ table[half & 15u];
}

static void soc_put_checked(soc_writer *w, uint8_t byte)
{
    w->crc = soc_crc(w->crc, byte);
    soc_put(w, byte);
}

static void soc_put_word(soc_writer *w, uint32_t word)
{
    for (unsigned shift = 0; shift < 32u; shift += 8u) {
        soc_put_checked(w, (uint8_t)(word >> shift));
    }
}

size_t soc_frame(uint8_t *frame, uint8_t number, uint8_t sequence, uint32_t time_us, const float *values, size_t count)
{
    soc_writer w = {frame, 0u, 1u, 0xFFFFFFFFu};

    soc_put_checked(&w, number);
    soc_put_checked(&w, sequence);
    soc_put_word(&w, time_us);
    for (size_t k = 0; k < count; ++k) {
        uint32_t bits;
        (void)memcpy(&bits, &values[k], sizeof bits);
        soc_put_word(&w, bits);
    }
    const uint32_t crc = ~w.crc;
    for (unsigned shift = 0; shift < 32u; shift += 8u) {
        soc_put(&w, (uint8_t)(crc >> shift));
    }
    frame[w.code] = (uint8_t)(w.next - w.code);
    frame[w.next] = 0u;
    return w.next + 1u;
}

void soc_sample_values(const soc_sample *sample, float *values)
{
    values[0] = sample->dt_s;
    values[1] = sample->current_A;
    values[2] = sample->voltage_V;
    values[3] = sample->temperature_degC;
}

void soc_output_values(const soc_output *output, float *values)
{
    values[0] = output->soc;
    values[1] = output->soc_std;
    values[2] = output->voltage_V;
    values[3] = output->voltage_std_V;
    values[4] = output->innovation_V;
    values[5] = output->current_offset_A;
    values[6] = output->current_offset_std_A;
    values[7] = output->soh_capacity;
    values[8] = output->soh_capacity_std;
    values[9] = output->resistance_ratio;
    values[10] = output->resistance_ratio_std;
    values[11] = output->flags;
}
