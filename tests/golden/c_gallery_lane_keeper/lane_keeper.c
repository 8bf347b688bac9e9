/* Step, init and reset of the model `lane_keeper`. Made by msnn; do not edit. */
#include "lane_keeper.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "lane_keeper_math.h"

#ifdef __FAST_MATH__
#error "compile without -ffast-math: it changes results"
#endif
/* 16: only _Float16, which is not used here, keeps its own arithmetic (gcc with AVX512-FP16) */
#if defined(FLT_EVAL_METHOD) && (FLT_EVAL_METHOD != 0) && (FLT_EVAL_METHOD != 16)
#error "compile for arithmetic in the declared type (on x86: -msse2 -mfpmath=sse)"
#endif
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

/* The smaller one, the first of equal ones; NaN if one is. */
static inline lane_keeper_real lane_keeper_minimum(lane_keeper_real a, lane_keeper_real b)
{
    return (a <= b) ? a : ((a > b) ? b : (a + b));
}

/* The larger one, the first of equal ones; NaN if one is. */
static inline lane_keeper_real lane_keeper_maximum(lane_keeper_real a, lane_keeper_real b)
{
    return (a >= b) ? a : ((a < b) ? b : (a + b));
}

/* x within low .. high. */
static inline lane_keeper_real lane_keeper_clamp(
    lane_keeper_real x,
    lane_keeper_real low,
    lane_keeper_real high)
{
    return lane_keeper_minimum(lane_keeper_maximum(x, low), high);
}

/* Reports a value outside low .. high. */
static inline void lane_keeper_flagged(
    lane_keeper_real x,
    lane_keeper_real low,
    lane_keeper_real high,
    lane_keeper_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= LANE_KEEPER_STATUS_OUT_OF_RANGE;
    } else {
        *status |= LANE_KEEPER_STATUS_NOT_A_NUMBER;
    }
}

/* A value outside low .. high moved into it; another one instead of NaN. */
static inline lane_keeper_real lane_keeper_clamped(
    lane_keeper_real x,
    lane_keeper_real low,
    lane_keeper_real high,
    lane_keeper_real instead,
    lane_keeper_status_t *status)
{
    lane_keeper_real result = instead;
    *status |= LANE_KEEPER_STATUS_CLAMPED;
    if (x > high) {
        result = high;
    } else if (x < low) {
        result = low;
    } else {
        *status |= LANE_KEEPER_STATUS_NOT_A_NUMBER;
    }
    return result;
}

/* Another one instead of a value outside low .. high. */
static inline lane_keeper_real lane_keeper_held(
    lane_keeper_real x,
    lane_keeper_real low,
    lane_keeper_real high,
    lane_keeper_real instead,
    lane_keeper_status_t *status)
{
    *status |= LANE_KEEPER_STATUS_HELD;
    if (!((x < low) || (x > high))) {
        *status |= LANE_KEEPER_STATUS_NOT_A_NUMBER;
    }
    return instead;
}

/* Initialises the state without history. */
void lane_keeper_init(lane_keeper_state_t *s, const LANE_KEEPER_PLACED lane_keeper_params_t *p)
{
    (void)p;
    for (uint32_t i = 0U; i < 5U; i++) {
        s->steering_tape[i] = 0.0f;
    }
    s->curvature_history[0U] = 0.0f;
    s->curvature_history[1U] = 0.0f;
    s->curvature_history[2U] = 0.0f;
    s->curvature_history[3U] = 0.0f;
    s->speed_held = 0.0f;
    s->ready = 7U;
}

/* Initialises the state from a known past; returns what was out of order. */
lane_keeper_status_t lane_keeper_reset(
    lane_keeper_state_t *s,
    const LANE_KEEPER_PLACED lane_keeper_params_t *p,
    const lane_keeper_init_t *x0)
{
    (void)p;
    lane_keeper_status_t status = LANE_KEEPER_OK;
    if (!(fabsf(x0->curvature[0U]) <= 0.05f)) {
        lane_keeper_flagged(x0->curvature[0U], -0.05f, 0.05f, &status);
    }
    if (!(fabsf(x0->curvature[1U]) <= 0.05f)) {
        lane_keeper_flagged(x0->curvature[1U], -0.05f, 0.05f, &status);
    }
    if (!(fabsf(x0->curvature[2U]) <= 0.05f)) {
        lane_keeper_flagged(x0->curvature[2U], -0.05f, 0.05f, &status);
    }
    if (!(fabsf(x0->curvature[3U]) <= 0.05f)) {
        lane_keeper_flagged(x0->curvature[3U], -0.05f, 0.05f, &status);
    }
    lane_keeper_real steering[5];
    for (uint32_t i = 0U; i < 5U; i++) {
        steering[i] = x0->steering[i];
        if (!(fabsf(x0->steering[i]) <= 0.6f)) {
            steering[i] = lane_keeper_clamped(x0->steering[i], -0.6f, 0.6f, 0.0f, &status);
        }
    }
    for (uint32_t i = 0U; i < 5U; i++) {
        s->steering_tape[i] = steering[i];
    }
    s->curvature_history[0U] = x0->curvature[0U];
    s->curvature_history[1U] = x0->curvature[1U];
    s->curvature_history[2U] = x0->curvature[2U];
    s->curvature_history[3U] = x0->curvature[3U];
    s->speed_held = 0.0f;
    s->ready = 4U;
    for (uint32_t i = 0U; i < 5U; i++) {
        if (!(fabsf(s->steering_tape[i]) <= 3.4028235e+38f)) {
            status |= LANE_KEEPER_STATUS_STATE_NOT_FINITE;
        }
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
lane_keeper_status_t lane_keeper_step(
    lane_keeper_state_t *s,
    const LANE_KEEPER_PLACED lane_keeper_params_t *p,
    const lane_keeper_in_t *u,
    lane_keeper_out_t *y)
{
    /* constants of the spec: width [m], brisk [m/s] */
    static const LANE_KEEPER_PLACED lane_keeper_real sets_slopes[2] = {
        0.1f, 0.083333336f
    };
    static const LANE_KEEPER_PLACED lane_keeper_real constants[3] = {
        8.0f, 18.0f, 30.0f
    };
    static const lane_keeper_real width = 1.0f;
    static const lane_keeper_real brisk = 20.0f;
    lane_keeper_status_t status = LANE_KEEPER_OK;
    /* inputs */
    for (uint32_t i = 0U; i < 8U; i++) {
        if (!(fabsf(u->curvature[i]) <= 0.05f)) {
            lane_keeper_flagged(u->curvature[i], -0.05f, 0.05f, &status);
        }
    }
    lane_keeper_real speed = u->speed;
    if (!((u->speed >= 0.0f) && (u->speed <= 40.0f))) {
        speed = lane_keeper_held(u->speed, 0.0f, 40.0f, s->speed_held, &status);
    }
    s->speed_held = speed;
    if (s->ready != 4U) {
        status |= LANE_KEEPER_STATUS_UNINITIALISED;
    }
    if ((s->ready & 1U) != 0U) {
        s->curvature_history[0U] = u->curvature[0U];
        s->curvature_history[1U] = u->curvature[0U];
        s->curvature_history[2U] = u->curvature[0U];
        s->curvature_history[3U] = u->curvature[0U];
        s->ready = s->ready & 6U;
    }
    s->curvature_history[4U] = u->curvature[0U];
    /* spec: anticipated = look(curvature[t-2:t+7]) (lane_keeper.msnn.yaml:30) */
    lane_keeper_real anticipated_part[12];
    for (uint32_t i = 0U; i < 5U; i++) {
        anticipated_part[i] = s->curvature_history[i];
    }
    for (uint32_t i = 0U; i < 7U; i++) {
        anticipated_part[i + 5U] = u->curvature[i + 1U];
    }
    /* spec: lane_keeper.msnn.yaml:26 */
    uint32_t sets_at = 0U;
    lane_keeper_real sets_here;
    lane_keeper_real sets_next;
    if (speed >= 30.0f) {
        sets_at = 1U;
        sets_here = 0.0f;
        sets_next = ((speed - 30.0f) * 0.0f) + 1.0f;
    } else if (speed >= 8.0f) {
        if (speed >= 18.0f) {
            sets_at = sets_at + 1U;
        }
        const lane_keeper_real sets_slope = sets_slopes[sets_at];
        sets_here = (constants[sets_at + 1U] - speed) * sets_slope;
        sets_next = (speed - constants[sets_at]) * sets_slope;
    } else {
        sets_here = ((speed - 8.0f) * 0.0f) + 1.0f;
        sets_next = 0.0f;
    }
    uint32_t sets_at_2 = 0U;
    if (u->offset >= 0.0f) {
        sets_at_2 = sets_at_2 + 1U;
    }
    /* spec: calm = softmax([0, 2 * speed / brisk, 1]) @ [1, 0.5, 0.8] (lane_keeper.msnn.yaml:32) */
    const lane_keeper_real calm_part = (2.0f * speed) / brisk;
    lane_keeper_real calm_part_2[3];
    calm_part_2[0U] = 0.0f;
    calm_part_2[1U] = calm_part;
    calm_part_2[2U] = 1.0f;
    const lane_keeper_real calm_part_3 = lane_keeper_maximum(lane_keeper_maximum(0.0f, calm_part),
        1.0f);
    lane_keeper_real calm_part_4[3];
    calm_part_4[0U] = lane_keeper_exp(calm_part_2[0U] - calm_part_3);
    calm_part_4[1U] = lane_keeper_exp(calm_part_2[1U] - calm_part_3);
    calm_part_4[2U] = lane_keeper_exp(calm_part_2[2U] - calm_part_3);
    const lane_keeper_real calm_part_5 = (calm_part_4[0U] + calm_part_4[1U]) + calm_part_4[2U];
    /* spec: anticipated (lane_keeper.msnn.yaml:30) */
    lane_keeper_real anticipated_sum = -0.0f;
    for (uint32_t i = 0U; i < 10U; i++) {
        anticipated_sum = anticipated_sum
            + (p->look_weight[((sets_at * 20U) + (sets_at_2 * 10U)) + i]
            * anticipated_part[i + 2U]);
    }
    lane_keeper_real anticipated_sum_2 = -0.0f;
    for (uint32_t i = 0U; i < 10U; i++) {
        anticipated_sum_2 = anticipated_sum_2
            + (p->look_weight[(((sets_at * 20U) + (sets_at_2 * 10U)) + i) + 20U]
            * anticipated_part[i + 2U]);
    }
    const lane_keeper_real anticipated = (((sets_here * 1.0f) * anticipated_sum) + 0.0f)
        + (((sets_next * 1.0f) * anticipated_sum_2) + 0.0f);
    /* spec: correction [1] = -0.02 * tanh(offset / width) / (1 + speed / brisk)
     * (lane_keeper.msnn.yaml:31) */
    const lane_keeper_real correction = ((-0.02f) * lane_keeper_tanh(u->offset / width))
        / (1.0f + (speed / brisk));
    /* spec: calm (lane_keeper.msnn.yaml:32) */
    const lane_keeper_real calm = (((calm_part_4[0U] / calm_part_5) * 1.0f)
        + ((calm_part_4[1U] / calm_part_5) * 0.5f)) + ((calm_part_4[2U] / calm_part_5) * 0.8f);
    /* spec: steering_next = clip(2 * anticipated + correction * calm + habit(steering) + 0.5 *
     * ahead(curvature.future(3)), -0.6, 0.6) (lane_keeper.msnn.yaml:36) */
    lane_keeper_real steering_next_sum = -0.0f;
    for (uint32_t i = 0U; i < 5U; i++) {
        steering_next_sum = steering_next_sum + (p->habit_weight[i] * s->steering_tape[i]);
    }
    const lane_keeper_real steering_next_part = 0.5f
        * (((p->ahead_weight[0U] * u->curvature[1U]) + (p->ahead_weight[1U] * u->curvature[2U]))
        + (p->ahead_weight[2U] * u->curvature[3U]));
    const lane_keeper_real steering_next_part_2 = (((2.0f * (anticipated + 0.0f))
        + (correction * calm)) + steering_next_sum) + steering_next_part;
    const lane_keeper_real steering_next = lane_keeper_clamp(steering_next_part_2, -0.6f, 0.6f);
    /* outputs */
    y->steering_next = steering_next;
    /* spec: lateral [m/s^2] = speed**2 * mean(curvature.past(5)) (lane_keeper.msnn.yaml:38) */
    lane_keeper_real lateral_sum = -0.0f;
    for (uint32_t i = 0U; i < 5U; i++) {
        lateral_sum = lateral_sum + s->curvature_history[i];
    }
    y->lateral = (speed * speed) * (lateral_sum / 5.0f);
    /* next states */
    s->steering_tape[0U] = s->steering_tape[1U];
    s->steering_tape[1U] = s->steering_tape[2U];
    s->steering_tape[2U] = s->steering_tape[3U];
    s->steering_tape[3U] = s->steering_tape[4U];
    s->steering_tape[4U] = steering_next;
    s->curvature_history[0U] = s->curvature_history[1U];
    s->curvature_history[1U] = s->curvature_history[2U];
    s->curvature_history[2U] = s->curvature_history[3U];
    s->curvature_history[3U] = s->curvature_history[4U];
    if (!(fabsf(s->steering_tape[4U]) <= 3.4028235e+38f)) {
        status |= LANE_KEEPER_STATUS_STATE_NOT_FINITE;
    }
    return status;
}
