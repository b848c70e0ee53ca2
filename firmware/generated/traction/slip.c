#include "slip.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

void slip_start(slip_state *state, const slip_sample *sample)
{
    (void)sample;
    (void)memset(state, 0, sizeof *state);
    state->estimate_known = 1.0f;
}

void slip_step(slip_state *state, const slip_sample *sample, slip_output *output)
{
    const float estimate_wheel_speed_rad_s = state->estimate_wheel_speed_rad_s;
    const float estimate_travel_speed_m_s = state->estimate_travel_speed_m_s;
    const float estimate_force_N = state->estimate_force_N;
    const float estimate_acceleration_m_s2 = state->estimate_acceleration_m_s2;
    const float estimate_known = state->estimate_known;
    const float memory_integral_m = state->memory_integral_m;
    const float torque_Nm = state->torque_Nm;
    const float slip_target = state->slip_target;
    const float direction = state->direction;
    const float limited_s = state->limited_s;
    const float command_slip_ratio = sample->command_slip_ratio;
    const float command_direction = sample->command_direction;
    const float measurement_wheel_speed_rad_s = sample->measurement_wheel_speed_rad_s;
    const float measurement_travel_speed_m_s = sample->measurement_travel_speed_m_s;
    const float measurement_age_s = sample->measurement_age_s;
    const float measurement_travel_speed_std_m_s = sample->measurement_travel_speed_std_m_s;
    const float measurement_force_N = sample->measurement_force_N;
    const float measurement_acceleration_m_s2 = sample->measurement_acceleration_m_s2;
    const float dt_s = sample->dt_s;
    /* plausible_step_s (traction/control/force_filter.py): The time since the previous step [s] */
    const float motion_dt_s = ((0.0f < dt_s) && (dt_s <= 60.0f)) ? dt_s : 0.0f;
    /* ForceFilter.usable (traction/control/force_filter.py): True where a controller may act on a measurement */
    const bool possible = (fabsf(measurement_wheel_speed_rad_s) <= 100000.0f) && (fabsf(measurement_travel_speed_m_s) <= 1000.0f);
    const bool recent = (0.0f <= measurement_age_s) && (measurement_age_s <= 0.1f);
    const bool usable = (possible && recent) && (measurement_travel_speed_std_m_s <= 0.1f);
    /* ForceFilter.update (traction/control/force_filter.py): Estimate after a step under `torque_Nm`; force and
       acceleration hold across a gap in the measurements */
    const float omega = usable ? measurement_wheel_speed_rad_s : estimate_wheel_speed_rad_s;
    state->estimate_wheel_speed_rad_s = omega;
    const float t2 = measurement_travel_speed_m_s + estimate_acceleration_m_s2 * measurement_age_s;
    const float estimate_travel_speed_m_s2 = usable ? t2 : estimate_travel_speed_m_s;
    state->estimate_travel_speed_m_s = estimate_travel_speed_m_s2;
    const float impulse = torque_Nm * motion_dt_s - 0.0108f * (omega - estimate_wheel_speed_rad_s);
    const float t3 = 0.005f + motion_dt_s;
    const float force_change = (impulse / 0.12f - estimate_force_N * motion_dt_s) / t3;
    const float speed_change = estimate_travel_speed_m_s2 - estimate_travel_speed_m_s - estimate_acceleration_m_s2 * motion_dt_s;
    const float acceleration_change = speed_change / (0.05f + motion_dt_s);
    const float observed_N = estimate_force_N + motion_dt_s * (measurement_force_N - estimate_force_N) / t3;
    const bool continuous = usable && (0.5f < estimate_known);
    const float filtered_N = estimate_force_N + (continuous ? force_change : 0.0f);
    const float filtered_m_s2 = estimate_acceleration_m_s2 + (continuous ? acceleration_change : 0.0f);
    const float estimate_force_N2 = (usable && (fabsf(measurement_force_N) <= 1e+07f)) ? observed_N : filtered_N;
    state->estimate_force_N = estimate_force_N2;
    output->report_force_N = estimate_force_N2;
    const bool t4 = usable && (fabsf(measurement_acceleration_m_s2) <= 100000.0f);
    const float estimate_acceleration_m_s2_2 = t4 ? measurement_acceleration_m_s2 : filtered_m_s2;
    state->estimate_acceleration_m_s2 = estimate_acceleration_m_s2_2;
    const float estimate_known2 = usable ? 1.0f : 0.0f;
    state->estimate_known = estimate_known2;
    /* SlipController.step (traction/control/slip_controller.py): State after the step, torque [N m] to hold for
       the next `dt_s`, and report */
    const float rim = 0.12f * omega;
    /* direction_of (traction/control/slip_controller.py): 1 forward, -1 reverse */
    const float commanded = (0.0f <= command_direction) ? 1.0f : (-1.0f);
    const bool t5 = command_slip_ratio < 0.0f;
    /* travel_direction (traction/dynamics/slip.py): 1 forwards, -1 in reverse */
    const float t6 = fabsf(rim);
    const float t7 = fabsf(estimate_travel_speed_m_s2);
    const float faster = (t7 < t6) ? rim : estimate_travel_speed_m_s2;
    /* direction_of */
    const float direction2 = t5 ? ((0.0f <= faster) ? 1.0f : (-1.0f)) : commanded;
    state->direction = direction2;
    /* is_slip (traction/control/slip_controller.py): True where the command is a slip ratio with a finite
       direction */
    const bool valid = (fabsf(command_slip_ratio) < 1.0f) && (fabsf(command_direction) < INFINITY);
    /* SlipController.target (traction/control/slip_controller.py): Slip ratio to hold in this step, on a ramp
       towards the command, and its rate [1/s] */
    const float commanded2 = valid ? command_slip_ratio : 0.0f;
    const float t8 = (commanded2 - slip_target) / ((motion_dt_s <= 1e-09f) ? 1e-09f : motion_dt_s);
    const float t9 = (t8 <= (-5.0f)) ? (-5.0f) : t8;
    const float rate = (t9 >= 5.0f) ? 5.0f : t9;
    const float target = slip_target + motion_dt_s * rate;
    output->report_slip_target = target;
    /* SlipController.motion (traction/control/slip_controller.py): Motion of the wheel along its direction, and
       its target slip */
    const float motion_rim_m_s = omega * (0.12f * direction2);
    const float motion_travel_m_s = estimate_travel_speed_m_s2 * direction2;
    const float motion_acceleration_m_s2 = estimate_acceleration_m_s2_2 * direction2;
    const float motion_force_N = estimate_force_N2 * direction2;
    const float motion_launch = (0.0f < target) ? 5.0f : 1.0f;
    const float before_Nm = torque_Nm * direction2;
    /* SlipController.step */
    const bool known = 0.5f < estimate_known2;
    /* has_stopped (traction/control/slip_controller.py): True where the robot brakes and is too slow to brake any
       further */
    const bool stopped = t5 && (((t6 > t7 || t6 != t6) ? t6 : t7) < 0.05f);
    /* SlipController.step */
    const bool acting = valid && (known && (!stopped));
    const bool condition = direction == direction2;
    /* choose (filters/gate.py): `a` where the scalar condition holds, else `b`, element by element through
       tuples, arrays and numbers */
    const float memory_integral_m2 = condition ? memory_integral_m : 0.0f;
    /* surface (traction/control/slip_law.py): The surface of a slip ratio in (-1, 1) for these speeds of rim and
       travel */
    const float rim2 = fabsf(motion_rim_m_s);
    const float travel = fabsf(motion_travel_m_s);
    const float V = (rim2 > travel || rim2 != rim2) ? rim2 : travel;
    const float t10 = 0.22f * motion_launch - V * (motion_launch - 1.0f);
    const float t11 = (0.22f > t10) ? 0.22f : t10;
    const float V_f = (V > t11 || V != V) ? V : t11;
    const bool rolling = 0.22f < V;
    const float slope = rolling ? 1.0f : 1.0f - motion_launch;
    const float here_sigma = motion_rim_m_s - motion_travel_m_s - target * V_f;
    output->report_surface_m_s = here_sigma;
    const float t12 = target * slope;
    const float here_gain = (travel <= rim2) ? 1.0f - t12 * ((0.0f <= motion_rim_m_s) ? 1.0f : (-1.0f)) : 1.0f;
    const float here_drift = (rim2 < travel) ? 1.0f + t12 * ((0.0f <= motion_travel_m_s) ? 1.0f : (-1.0f)) : 1.0f;
    /* SlidingMode.gain_m_s2 (traction/control/sliding_mode.py): The smallest k that satisfies the sliding
       condition */
    const float by_force = 51.484913f * (0.0144f * here_gain) / 0.0108f;
    /* equivalent_rate (traction/control/sliding_mode.py): The gain r domega/dt [m/s^2] that holds sigma constant
       */
    const float t13 = motion_acceleration_m_s2 * here_drift + rate * V_f;
    /* SlidingMode.gain_m_s2 */
    const float by_inertia = 0.2f * fabsf(t13);
    const float k = by_force + by_inertia + 1.2f * (1.0f + here_drift);
    /* SlidingMode.layer_m_s (traction/control/sliding_mode.py): Phi for the gain k */
    const float t14 = 5.0f * motion_dt_s;
    const float layer_m_s = k * ((0.005f > t14) ? 0.005f : t14);
    /* SlidingMode.torque_with (traction/control/sliding_mode.py): Torque [N m] of the law with another gain k
       [m/s^2] and layer */
    const float inertia_kg_m = 0.0108f / (0.12f * here_gain);
    const float distance = here_sigma / layer_m_s;
    /* direction_and_size (traction/friction/law.py): 1 or -1, and |x|, with x = direction * size */
    const bool forward = 0.0f <= distance;
    const float direction3 = forward ? 1.0f : (-1.0f);
    const float size = forward ? distance : -distance;
    /* reaching_share (traction/control/sliding_mode.py): Rate at which sigma should decrease, over k, at a
       distance in layers */
    const float t15 = (1.0f < size) ? sqrtf(2.0f * ((size <= 1.0f) ? 1.0f : size) - 1.0f) : size;
    /* SlidingMode.torque_with */
    const float rate2 = t13 - k * (direction3 * t15);
    const float torque_Nm2 = 0.12f * motion_force_N + inertia_kg_m * rate2;
    const float growth_Nm = motion_dt_s * (k * (k * inertia_kg_m) / layer_m_s) / 2.0f;
    const float t16 = ((before_Nm >= 0.0f) ? 0.0f : before_Nm) - growth_Nm;
    const float t17 = growth_Nm + ((before_Nm <= 0.0f) ? 0.0f : before_Nm);
    const float t18 = (torque_Nm2 > t16 || torque_Nm2 != torque_Nm2) ? torque_Nm2 : t16;
    /* SlipController.step */
    const float demanded = acting ? direction2 * ((t18 < t17 || t18 != t18) ? t18 : t17) : 0.0f;
    output->report_demanded_Nm = demanded;
    /* Limits.apply (traction/control/signals.py): The torque nearest to the demanded one that may follow
       `before_Nm`, which is within the limits */
    const float change = 5000.0f * motion_dt_s;
    const float t19 = torque_Nm - change;
    const float t20 = torque_Nm + change;
    const float t21 = (demanded > t19 || demanded != demanded) ? demanded : t19;
    const float t22 = (t21 < t20 || t21 != t21) ? t21 : t20;
    const float t23 = (t22 <= (-12.356379f)) ? (-12.356379f) : t22;
    const float torque = (t23 >= 12.356379f) ? 12.356379f : t23;
    state->torque_Nm = torque;
    output->torque_Nm = torque;
    /* SlipController.step */
    const float demanded_Nm = direction2 * demanded;
    const float torque_Nm3 = direction2 * torque;
    /* SlidingMode.remember (traction/control/sliding_mode.py): The integral grows above the floor and near the
       target, unless a limited torque would wind it up */
    const float t24 = fabsf(here_sigma);
    const bool outside = 0.1f * V_f < t24;
    const bool windup = (1e-09f < fabsf(demanded_Nm - torque_Nm3)) && (0.0f < here_sigma * (torque_Nm3 - demanded_Nm));
    const float integral = memory_integral_m2 + ((outside || windup) ? 0.0f : motion_dt_s * here_sigma);
    const float a = rolling ? integral : 0.0f;
    /* limited (traction/control/signals.py): True where the torque differs from the demanded one */
    const bool saturated = 1e-09f < fabsf(demanded - torque);
    /* SlipController.step */
    const bool missed = saturated && (0.02f * V_f < t24);
    const float limited_s2 = (acting && missed) ? limited_s + motion_dt_s : 0.0f;
    state->limited_s = limited_s2;
    /* flags_of (filters/flags.py): Sum of the flags whose condition holds, as a float */
    const float t25 = (known ? 0.0f : 1.0f) + ((known && stopped) ? 2.0f : 0.0f) + (saturated ? 4.0f : 0.0f);
    const float flags = t25 + ((0.2f < limited_s2) ? 16.0f : 0.0f) + (valid ? 0.0f : 32.0f);
    output->report_flags = flags;
    /* SlipController.step */
    const float rim_speed_m_s = direction2 * motion_rim_m_s;
    const float travel_speed_m_s = direction2 * motion_travel_m_s;
    /* travel_direction */
    const float t26 = fabsf(rim_speed_m_s);
    const float t27 = fabsf(travel_speed_m_s);
    const float faster2 = (t27 < t26) ? rim_speed_m_s : travel_speed_m_s;
    /* slip_ratio (traction/dynamics/slip.py): Slip speed over the larger of the two speeds */
    const float speed = (t26 > t27 || t26 != t26) ? t26 : t27;
    const float ratio = (rim_speed_m_s - travel_speed_m_s) / ((speed <= 0.02f) ? 0.02f : speed);
    /* driving_slip_ratio (traction/dynamics/slip.py): The slip ratio, positive driving and negative braking in
       reverse too */
    const float ratio2 = ((0.0f <= faster2) ? 1.0f : (-1.0f)) * ((speed < 0.02f) ? NAN : ratio);
    output->report_slip_ratio = ratio2;
    /* choose */
    state->memory_integral_m = acting ? a : 0.0f;
    /* SlipController.step */
    state->slip_target = acting ? target : 0.0f;
}
