/* Frames for the serial line to `ohmward run`.

   frame = COBS(number, sequence, time, values, crc), 0
   time and crc are 32 bit, values IEEE 754 single precision, all with the low byte first; crc is that of IEEE 802.3.
   COBS (Cheshire and Baker 1999) leaves no zero in a frame, so that a receiver finds the next one after any fault. */
#include "soc_frame.h"

#include <string.h>

typedef struct {
    uint8_t *code; /* where the length of the present block goes */
    uint8_t *next;
    uint32_t crc;
} writer;

static void put(writer *w, uint8_t byte)
{
    if (byte != 0u) {
        *w->next++ = byte;
    }
    if (byte == 0u || w->next - w->code == 255) {
        *w->code = (uint8_t)(w->next - w->code);
        w->code = w->next++;
    }
}

static uint32_t crc_after(uint32_t crc, uint8_t byte)
{
    static const uint32_t table[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu,
    };
    crc ^= byte;
    crc = (crc >> 4) ^ table[crc & 15u];
    return (crc >> 4) ^ table[crc & 15u];
}

static void put_checked(writer *w, uint8_t byte)
{
    w->crc = crc_after(w->crc, byte);
    put(w, byte);
}

static void put_word(writer *w, uint32_t word)
{
    for (unsigned shift = 0; shift < 32u; shift += 8u) {
        put_checked(w, (uint8_t)(word >> shift));
    }
}

size_t soc_frame(uint8_t *frame, uint8_t number, uint8_t sequence, uint32_t time_us, const float *values, size_t count)
{
    writer w = {frame, frame + 1, 0xFFFFFFFFu};

    put_checked(&w, number);
    put_checked(&w, sequence);
    put_word(&w, time_us);
    for (size_t k = 0; k < count; ++k) {
        uint32_t bits;
        memcpy(&bits, &values[k], sizeof bits);
        put_word(&w, bits);
    }
    const uint32_t crc = ~w.crc;
    for (unsigned shift = 0; shift < 32u; shift += 8u) {
        put(&w, (uint8_t)(crc >> shift));
    }
    *w.code = (uint8_t)(w.next - w.code);
    *w.next++ = 0u;
    return (size_t)(w.next - frame);
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
