#ifndef SOC_H
#define SOC_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SOC_NO_CURRENT 1 /* missing or impossible: the last current was held, and faded */
#define SOC_NO_VOLTAGE 2 /* missing or impossible: predicted only */
#define SOC_BAD_TIME 4 /* dt_s not a number, negative or over a year: 0 was used; dt_s = 0 is a repeated sample */
#define SOC_GAP 8 /* step too long to assume a straight line between its two currents */
#define SOC_VOLTAGE_REJECTED 16 /* innovation outside its gate, or a jump that has not lasted yet */
#define SOC_REST 32 /* current known: the zero-current update was made */
#define SOC_SOC_LIMITED 64 /* estimate projected into [0, 1] */
#define SOC_NOT_POSITIVE_DEFINITE 128 /* the covariance had to be repaired; by a filter of the laboratory alone */
#define SOC_DIVERGED 256 /* the voltage has contradicted the estimate for too long: SoC was declared unknown */
#define SOC_RESTARTED 512 /* in Python: started again from this sample: a wrong or missing first voltage, or a state of NaN */
#define SOC_ANCHORED 1024 /* a full charge, the steep end of a flat curve or the cut-off of a load corrected SoC */
#define SOC_MISFIT 2048 /* an offset or a capacity that sensor and battery cannot have: another battery's file? */
#define SOC_EXCHANGED 4096 /* in Python: the voltage stepped over a silence: another battery is in, and started from here */

typedef struct {
    float belief_mean[3]; /* mean of the states, in the order of the model */
    float belief_lower[6]; /* lower triangle of the covariance, row by row */
    float current_A; /* of the sample before */
} soc_state;

typedef struct {
    float dt_s; /* time since the sample before [s]; 0 for the first */
    float current_A; /* measured current [A], > 0 charges */
    float voltage_V; /* measured terminal voltage [V] of the whole pack */
    float temperature_degC; /* of the battery */
} soc_sample;

typedef struct {
    float soc; /* state of charge in [0, 1] */
    float soc_std; /* standard deviation of the state of charge */
    float voltage_V; /* terminal voltage [V] expected before the measurement */
    float voltage_std_V; /* standard deviation of the expected voltage [V] */
    float innovation_V; /* measured minus expected voltage [V]; nan when the voltage was not used */
    float current_offset_A; /* current sensor's reading at zero current [A] */
    float current_offset_std_A; /* standard deviation of that reading [A] */
    float soh_capacity; /* capacity over the battery file's */
    float soh_capacity_std; /* standard deviation of the capacity over the battery file's */
    float resistance_ratio; /* resistance over the battery file's */
    float resistance_ratio_std; /* standard deviation of the resistance over the battery file's */
    float flags; /* sum of SOC_... values; 0 is a sample without incident */
} soc_output;

/* The state before the first sample; then give that sample to the step. `soc` (0 to 1) and `soc_std` (above
   0) are the state of charge and its standard deviation, which the first steps correct. */
void soc_start(soc_state *state, const soc_sample *sample, float soc, float soc_std);

/* One sample: `state` moves on, `output` is filled. Nothing is allocated, nothing remembered elsewhere. */
void soc_step(soc_state *state, const soc_sample *sample, soc_output *output);

#ifdef __cplusplus
}
#endif

#endif
