/* Saved state: identity, state, crc of both; the numbers are those of this processor. */
#include "soc_saved.h"

#include "soc_frame.h"

#include <string.h>

static uint32_t soc_crc_of(const uint8_t *bytes, size_t count)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (size_t k = 0; k < count; ++k) {
        crc = soc_crc(crc, bytes[k]);
    }
    return ~crc;
}

void soc_save(const soc_state *state, uint8_t *bytes)
{
    const uint32_t identity = SOC_IDENTITY;
    const size_t end = sizeof identity + sizeof *state;
    (void)memcpy(bytes, &identity, sizeof identity);
    (void)memcpy(&bytes[sizeof identity], state, sizeof *state);
    const uint32_t crc = soc_crc_of(bytes, end);
    (void)memcpy(&bytes[end], &crc, sizeof crc);
}

bool soc_load(soc_state *state, const uint8_t *bytes)
{
    uint32_t identity;
    uint32_t crc;
    const size_t end = sizeof identity + sizeof *state;
    (void)memcpy(&identity, bytes, sizeof identity);
    (void)memcpy(&crc, &bytes[end], sizeof crc);
    const bool is_ours = (identity == SOC_IDENTITY) && (crc == soc_crc_of(bytes, end));
    if (is_ours) {
        (void)memcpy(state, &bytes[sizeof identity], sizeof *state);
    }
    return is_ours;
}
