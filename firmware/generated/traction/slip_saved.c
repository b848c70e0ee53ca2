/* Saved state: identity, state, crc of both; the numbers are those of this processor. */
#include "slip_saved.h"

#include "slip_frame.h"

#include <string.h>

static uint32_t slip_crc_of(const uint8_t *bytes, size_t count)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t k = 0; k < count; ++k) {
        crc = slip_crc(crc, bytes[k]);
    }
    return ~crc;
}

void slip_save(const slip_state *state, uint8_t *bytes)
{
    const uint32_t identity = SLIP_IDENTITY;
    const size_t end = sizeof identity + sizeof *state;
    (void)memcpy(bytes, &identity, sizeof identity);
    (void)memcpy(&bytes[sizeof identity], state, sizeof *state);
    const uint32_t crc = slip_crc_of(bytes, end);
    (void)memcpy(&bytes[end], &crc, sizeof crc);
}

bool slip_load(slip_state *state, const uint8_t *bytes)
{
    uint32_t identity;
    uint32_t crc;
    const size_t end = sizeof identity + sizeof *state;
    (void)memcpy(&identity, bytes, sizeof identity);
    (void)memcpy(&crc, &bytes[end], sizeof crc);
    const bool is_ours = (identity == SLIP_IDENTITY) && (crc == slip_crc_of(bytes, end));
    if (is_ours) {
        (void)memcpy(state, &bytes[sizeof identity], sizeof *state);
    }
    return is_ours;
}
