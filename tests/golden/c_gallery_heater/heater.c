/* Step, init and reset of the model `heater`. Made by msnn; do not edit. */
#include "heater.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "heater_math.h"

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
static inline heater_real heater_minimum(heater_real a, heater_real b)
{
    return (a <= b) ? a : ((a > b) ? b : (a + b));
}

/* The larger one, the first of equal ones; NaN if one is. */
static inline heater_real heater_maximum(heater_real a, heater_real b)
{
    return (a >= b) ? a : ((a < b) ? b : (a + b));
}

/* x within low .. high. */
static inline heater_real heater_clamp(heater_real x, heater_real low, heater_real high)
{
    return heater_minimum(heater_maximum(x, low), high);
}

/* Reports a value outside low .. high. */
static inline void heater_flagged(
    heater_real x,
    heater_real low,
    heater_real high,
    heater_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= HEATER_STATUS_OUT_OF_RANGE;
    } else {
        *status |= HEATER_STATUS_NOT_A_NUMBER;
    }
}

/* A value outside low .. high moved into it; another one instead of NaN. */
static inline heater_real heater_clamped(
    heater_real x,
    heater_real low,
    heater_real high,
    heater_real instead,
    heater_status_t *status)
{
    heater_real result = instead;
    *status |= HEATER_STATUS_CLAMPED;
    if (x > high) {
        result = high;
    } else if (x < low) {
        result = low;
    } else {
        *status |= HEATER_STATUS_NOT_A_NUMBER;
    }
    return result;
}

/* Another one instead of a value outside low .. high. */
static inline heater_real heater_held(
    heater_real x,
    heater_real low,
    heater_real high,
    heater_real instead,
    heater_status_t *status)
{
    *status |= HEATER_STATUS_HELD;
    if (!((x < low) || (x > high))) {
        *status |= HEATER_STATUS_NOT_A_NUMBER;
    }
    return instead;
}

/* Initialises the state without history. */
void heater_init(heater_state_t *s, const HEATER_PLACED heater_params_t *p)
{
    (void)p;
    s->error_sum = 0.0f;
    s->element_state[0U] = 0.0f;
    s->element_state[1U] = 0.0f;
    s->element_state[2U] = 0.0f;
    s->oven = 0.0f;
    s->duty_history[0U] = 0.0f;
    s->wanted_held = 0.0f;
    s->ready = 7U;
}

/* Initialises the state from a known past; returns what was out of order. */
heater_status_t heater_reset(
    heater_state_t *s,
    const HEATER_PLACED heater_params_t *p,
    const heater_init_t *x0)
{
    (void)p;
    heater_status_t status = HEATER_OK;
    heater_real duty = x0->duty;
    if (!((x0->duty >= 0.0f) && (x0->duty <= 1.0f))) {
        duty = heater_clamped(x0->duty, 0.0f, 1.0f, 0.0f, &status);
    }
    if (!((x0->oven >= (-20.0f)) && (x0->oven <= 400.0f))) {
        heater_flagged(x0->oven, -20.0f, 400.0f, &status);
    }
    s->oven = x0->oven;
    s->error_sum = 0.0f;
    s->element_state[0U] = 0.0f;
    s->element_state[1U] = 0.0f;
    s->element_state[2U] = 0.0f;
    s->duty_history[0U] = duty;
    s->wanted_held = 0.0f;
    s->ready = 4U;
    if (!((s->oven >= (-20.0f)) && (s->oven <= 400.0f))) {
        status |= HEATER_STATUS_STATE_OUT_OF_RANGE;
    }
    if (!(fabsf(s->error_sum) <= 500.0f)) {
        status |= HEATER_STATUS_STATE_OUT_OF_RANGE;
    }
    if (!(fabsf(s->element_state[0U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->element_state[1U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->element_state[2U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
heater_status_t heater_step(
    heater_state_t *s,
    const HEATER_PLACED heater_params_t *p,
    const heater_in_t *u,
    heater_out_t *y)
{
    heater_status_t status = HEATER_OK;
    /* inputs */
    heater_real wanted = u->wanted;
    if (!((u->wanted >= 0.0f) && (u->wanted <= 200.0f))) {
        wanted = heater_held(u->wanted, 0.0f, 200.0f, s->wanted_held, &status);
    }
    s->wanted_held = wanted;
    heater_real duty = u->duty;
    if (!((u->duty >= 0.0f) && (u->duty <= 1.0f))) {
        duty = heater_clamped(u->duty, 0.0f, 1.0f, 0.0f, &status);
    }
    if (s->ready != 4U) {
        status |= HEATER_STATUS_UNINITIALISED;
    }
    if ((s->ready & 1U) != 0U) {
        s->duty_history[0U] = duty;
        s->ready = s->ready & 6U;
    }
    s->duty_history[1U] = duty;
    /* spec: warmth = sigmoid(element(duty[t-2]) + 4 * duty[t-1] - 2) (heater.msnn.yaml:28) */
    const heater_real warmth_part = -(p->element_reflection[2U] * s->element_state[2U]);
    const heater_real warmth_part_2 = sqrtf(1.0f
        - (p->element_reflection[1U] * p->element_reflection[1U]));
    const heater_real warmth_part_3 = (warmth_part_2 * warmth_part)
        - (p->element_reflection[1U] * s->element_state[1U]);
    const heater_real warmth_part_4 = sqrtf(1.0f
        - (p->element_reflection[0U] * p->element_reflection[0U]));
    heater_real warmth_part_5[3];
    warmth_part_5[0U] = (warmth_part_4 * warmth_part_3)
        - (p->element_reflection[0U] * s->element_state[0U]);
    warmth_part_5[1U] = (p->element_reflection[0U] * warmth_part_3)
        + (warmth_part_4 * s->element_state[0U]);
    warmth_part_5[2U] = (p->element_reflection[1U] * warmth_part)
        + (warmth_part_2 * s->element_state[1U]);
    const heater_real warmth_part_6 = (((p->element_C[0U] * s->element_state[0U])
        + (p->element_C[1U] * s->element_state[1U])) + (p->element_C[2U] * s->element_state[2U]))
        + (p->element_D[0U] * s->duty_history[0U]);
    const heater_real warmth = heater_sigmoid((warmth_part_6 + (4.0f * duty)) - 2.0f);
    /* spec: der(oven) = power * warmth - loss * oven - radiated * sinh(oven / 100)
     * (heater.msnn.yaml:22) */
    const heater_real oven_der_part = p->power * warmth;
    const heater_real oven_der_part_2 = (oven_der_part - (p->loss * s->oven))
        - (p->radiated * heater_sinh(s->oven / 100.0f));
    /* spec: oven_for_k2 (heater.msnn.yaml:22) */
    const heater_real oven_for_k2 = s->oven + (0.125f * oven_der_part_2);
    /* spec: der(oven) (heater.msnn.yaml:22) */
    const heater_real oven_der_part_3 = (oven_der_part - (p->loss * oven_for_k2))
        - (p->radiated * heater_sinh(oven_for_k2 / 100.0f));
    /* spec: oven_1 (heater.msnn.yaml:22) */
    const heater_real oven_1 = s->oven + (0.25f * oven_der_part_3);
    /* spec: der(oven) (heater.msnn.yaml:22) */
    const heater_real oven_der_part_4 = (oven_der_part - (p->loss * oven_1))
        - (p->radiated * heater_sinh(oven_1 / 100.0f));
    /* spec: oven_for_k2 (heater.msnn.yaml:22) */
    const heater_real oven_for_k2_2 = oven_1 + (0.125f * oven_der_part_4);
    /* spec: der(oven) (heater.msnn.yaml:22) */
    const heater_real oven_der_part_5 = (oven_der_part - (p->loss * oven_for_k2_2))
        - (p->radiated * heater_sinh(oven_for_k2_2 / 100.0f));
    /* spec: oven_next (heater.msnn.yaml:22) */
    const heater_real oven_next = oven_1 + (0.25f * oven_der_part_5);
    /* spec: asked = min(max(proportional * (wanted - oven) + 0.001 * error_sum, 0), 1)
     * (heater.msnn.yaml:33) */
    const heater_real asked_part = wanted - s->oven;
    /* spec: ageing = elu(wear(oven / 200)) + cosh(oven / 400) - 1 (heater.msnn.yaml:29) */
    const heater_real ageing_part = (p->wear_weight[0U] * (s->oven / 200.0f)) + p->wear_bias;
    /* outputs */
    /* spec: oven_next (heater.msnn.yaml:22) */
    y->oven_next = oven_next;
    /* spec: asked (heater.msnn.yaml:33) */
    y->asked = heater_minimum(heater_maximum((p->proportional * asked_part)
        + (0.001f * s->error_sum), 0.0f), 1.0f);
    /* spec: ageing (heater.msnn.yaml:29) */
    const heater_real ageing_part_2 = ((ageing_part > 0.0f) ? ageing_part
        : (heater_exp(heater_minimum(ageing_part, 0.0f)) - 1.0f)) + heater_cosh(s->oven / 400.0f);
    y->ageing_now = ageing_part_2 - 1.0f;
    /* next states */
    /* spec: next(error_sum) = clip(error_sum + dt * (wanted - oven), -500, 500)
     * (heater.msnn.yaml:23) */
    const heater_real error_sum_next = heater_clamp(s->error_sum + (0.5f * asked_part), -500.0f,
        500.0f);
    /* spec: warmth (heater.msnn.yaml:28) */
    heater_real element_state_next[3];
    element_state_next[0U] = (0.9f * warmth_part_5[0U]) + (p->element_B[0U] * s->duty_history[0U]);
    element_state_next[1U] = (0.9f * warmth_part_5[1U]) + (p->element_B[1U] * s->duty_history[0U]);
    element_state_next[2U] = (0.9f * warmth_part_5[2U]) + (p->element_B[2U] * s->duty_history[0U]);
    s->oven = oven_next;
    s->error_sum = error_sum_next;
    s->element_state[0U] = element_state_next[0U];
    s->element_state[1U] = element_state_next[1U];
    s->element_state[2U] = element_state_next[2U];
    s->duty_history[0U] = s->duty_history[1U];
    if (!((s->oven >= (-20.0f)) && (s->oven <= 400.0f))) {
        status |= HEATER_STATUS_STATE_OUT_OF_RANGE;
    }
    if (!(fabsf(s->error_sum) <= 500.0f)) {
        status |= HEATER_STATUS_STATE_OUT_OF_RANGE;
    }
    if (!(fabsf(s->element_state[0U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->element_state[1U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->element_state[2U]) <= 3.4028235e+38f)) {
        status |= HEATER_STATUS_STATE_NOT_FINITE;
    }
    return status;
}
