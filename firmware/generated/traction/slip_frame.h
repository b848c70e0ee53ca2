/* Frames for the serial line to `ohmward run`: numbers with a time and a CRC-32, between zero bytes. */
#ifndef SLIP_FRAME_H
#define SLIP_FRAME_H

#include "slip.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Most bytes of a frame with so many values, 250 at most. */
#define SLIP_FRAME_BYTES(count) (4u * (count) + 10u + (4u * (count) + 10u) / 254u + 3u)

/* Write a frame and return its length in bytes.

   number:   of the message; the setup of `ohmward run` names its values.
   sequence: one more with each frame of this number, from 255 back to 0; a gap tells of frames that were lost.
   time_us:  of the measurement, from a timer of 1 MHz that may overflow.
   values:   NAN where there is none. */
size_t slip_frame(uint8_t *frame, uint8_t number, uint8_t sequence, uint32_t time_us, const float *values, size_t count);

/* CRC-32 of IEEE 802.3 after another byte; begins with 0xFFFFFFFF and ends inverted. */
uint32_t slip_crc(uint32_t crc, uint8_t byte);

#define SLIP_SAMPLE_VALUES 9u
#define SLIP_OUTPUT_VALUES 7u

/* Members as values, in the order of their tables in README.md. */
void slip_sample_values(const slip_sample *sample, float *values);
void slip_output_values(const slip_output *output, float *values);

#ifdef __cplusplus
}
#endif

#endif
