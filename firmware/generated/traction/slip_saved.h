/* The state over a power cycle: bytes for flash, FRAM or a file, with the identity of this library and a CRC-32. */
#ifndef SLIP_SAVED_H
#define SLIP_SAVED_H

#include "slip.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Another battery, filter or version has another number. */
#define SLIP_IDENTITY 0x4B97CF16u
#define SLIP_SAVED_BYTES (sizeof(slip_state) + 8u)

/* Write a state as SLIP_SAVED_BYTES bytes. */
void slip_save(const slip_state *state, uint8_t *bytes);

/* Read one. False, with the state as it was, if the bytes are erased, damaged or of another library: then start. */
bool slip_load(slip_state *state, const uint8_t *bytes);

#ifdef __cplusplus
}
#endif

#endif
