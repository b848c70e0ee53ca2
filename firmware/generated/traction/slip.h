#ifndef SLIP_H
#define SLIP_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SLIP_STALE 1 /* the measurement is too old, too uncertain or not a number: torque goes to zero */
#define SLIP_STOPPED 2 /* too slow for slip to be meaningful: a slip controller gives no torque, the speed controller holds */
#define SLIP_TORQUE_LIMITED 4 /* the demanded torque exceeds its limit, or changes faster than its limit */
#define SLIP_SLIP_BOUND 8 /* the speed controller gives less torque than the speed needs, to stay within the slip bound */
#define SLIP_UNREACHABLE 16 /* the commanded slip is not reached although the torque has been at its limit for a while */
#define SLIP_BAD_COMMAND 32 /* the command is not a number or out of its range: torque goes to zero */

typedef struct {
    float estimate_wheel_speed_rad_s; /* last usable one */
    float estimate_travel_speed_m_s; /* last usable one, predicted by its age; held while none is usable */
    float estimate_force_N; /* of the ground along x */
    float estimate_acceleration_m_s2; /* of the wheel's centre */
    float estimate_known; /* 1 where the last measurement was usable, else 0 */
    float memory_integral_m;
    float torque_Nm; /* given in the last step */
    float slip_target; /* slip ratio reached by the ramp */
    float direction; /* 1 forward, -1 reverse, 0 before the first step */
    float limited_s; /* time for which the torque limit has kept the slip away from its target */
} slip_state;

typedef struct {
    float command_slip_ratio; /* in (-1, 1), > 0 drives and < 0 brakes, in either direction of travel */
    float command_direction; /* >= 0 forward, < 0 reverse */
    float measurement_wheel_speed_rad_s; /* of the wheel, > 0 forward */
    float measurement_travel_speed_m_s; /* of the wheel's centre along the wheel, measured or estimated */
    float measurement_age_s; /* of the travel speed, >= 0 */
    float measurement_travel_speed_std_m_s; /* its standard deviation */
    float measurement_force_N; /* of the ground on the wheel, from an estimator; nan without one */
    float measurement_acceleration_m_s2; /* of the wheel's centre, likewise */
    float dt_s; /* time since the step before [s], > 0 */
} slip_sample;

typedef struct {
    float torque_Nm; /* to hold until the next step [N m] */
    float report_slip_ratio; /* driving > 0 and braking < 0; nan below a floor of speed */
    float report_slip_target; /* slip ratio that is held now, or the bound */
    float report_surface_m_s; /* distance from the target as a slip speed, > 0 if slip is too large */
    float report_force_N; /* of the ground on the wheel, along x, as estimated */
    float report_demanded_Nm; /* torque without limits */
    float report_flags; /* sum of SLIP_... values */
} slip_output;

/* The state before the first sample; then give that sample to the step. */
void slip_start(slip_state *state, const slip_sample *sample);

/* One sample: `state` moves on, `output` is filled. Nothing is allocated, nothing remembered elsewhere. */
void slip_step(slip_state *state, const slip_sample *sample, slip_output *output);

#ifdef __cplusplus
}
#endif

#endif
