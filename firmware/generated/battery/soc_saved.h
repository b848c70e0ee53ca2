/* The state over a power cycle: bytes for flash, FRAM or a file, with the identity of this library and a CRC-32. */
#ifndef SOC_SAVED_H
#define SOC_SAVED_H

#include "soc.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Another battery, filter or version has another number. */
#define SOC_IDENTITY 0xF37817EFu
#define SOC_SAVED_BYTES (sizeof(soc_state) + 8u)

/* Write a state as SOC_SAVED_BYTES bytes. */
void soc_save(const soc_state *state, uint8_t *bytes);

/* Read one. False, with the state as it was, if the bytes are erased, damaged or of another library: then start. */
bool soc_load(soc_state *state, const uint8_t *bytes);

#ifdef __cplusplus
}
#endif

#endif
