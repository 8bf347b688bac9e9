/* Step, init and reset of the model `reference`. Made by msnn; do not edit. */
#include "reference.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "reference_math.h"

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

/* Reports a value outside low .. high. */
static inline void reference_flagged(
    reference_real x,
    reference_real low,
    reference_real high,
    reference_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= REFERENCE_STATUS_OUT_OF_RANGE;
    } else {
        *status |= REFERENCE_STATUS_NOT_A_NUMBER;
    }
}

/* Initialises the state without history. */
void reference_init(reference_state_t *s, const REFERENCE_PLACED reference_params_t *p)
{
    (void)p;
    s->v = 0.0f;
    for (uint32_t i = 0U; i < 24U; i++) {
        s->u_history[i] = 0.0f;
    }
    s->ready = 7U;
}

/* Initialises the state from a known past; returns what was out of order. */
reference_status_t reference_reset(
    reference_state_t *s,
    const REFERENCE_PLACED reference_params_t *p,
    const reference_init_t *x0)
{
    (void)p;
    reference_status_t status = REFERENCE_OK;
    if (!(fabsf(x0->v) <= 50.0f)) {
        reference_flagged(x0->v, -50.0f, 50.0f, &status);
    }
    s->v = x0->v;
    for (uint32_t i = 0U; i < 24U; i++) {
        s->u_history[i] = x0->u[i];
    }
    s->ready = 4U;
    if (!(fabsf(s->v) <= 50.0f)) {
        status |= REFERENCE_STATUS_STATE_OUT_OF_RANGE;
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
reference_status_t reference_step(
    reference_state_t *s,
    const REFERENCE_PLACED reference_params_t *p,
    const reference_in_t *u,
    reference_out_t *y)
{
    static const REFERENCE_PLACED reference_real constants[7] = {
        -45.0f, -30.0f, -15.0f, 0.0f, 15.0f, 30.0f, 45.0f
    };
    reference_status_t status = REFERENCE_OK;
    /* inputs */
    if (s->ready != 4U) {
        status |= REFERENCE_STATUS_UNINITIALISED;
    }
    if ((s->ready & 1U) != 0U) {
        for (uint32_t i = 0U; i < 24U; i++) {
            s->u_history[i] = u->u;
        }
        s->ready = s->ready & 6U;
    }
    /* spec: next(v) = v + dt * (gain(command(u)) + p0 * tanh(p1 * v + p2))
     * (reference.msnn.yaml:27) */
    reference_real v_next_sum = -0.0f;
    reference_real v_next_sum_sample = s->u_history[0U];
    for (uint32_t i = 0U; i < 18U; i += 6U) {
        v_next_sum = v_next_sum + (p->command_weight[i] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 1U];
        s->u_history[i] = v_next_sum_sample;
        v_next_sum = v_next_sum + (p->command_weight[i + 1U] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 2U];
        s->u_history[i + 1U] = v_next_sum_sample;
        v_next_sum = v_next_sum + (p->command_weight[i + 2U] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 3U];
        s->u_history[i + 2U] = v_next_sum_sample;
        v_next_sum = v_next_sum + (p->command_weight[i + 3U] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 4U];
        s->u_history[i + 3U] = v_next_sum_sample;
        v_next_sum = v_next_sum + (p->command_weight[i + 4U] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 5U];
        s->u_history[i + 4U] = v_next_sum_sample;
        v_next_sum = v_next_sum + (p->command_weight[i + 5U] * v_next_sum_sample);
        v_next_sum_sample = s->u_history[i + 6U];
        s->u_history[i + 5U] = v_next_sum_sample;
    }
    v_next_sum = v_next_sum + (p->command_weight[18U] * v_next_sum_sample);
    v_next_sum_sample = s->u_history[19U];
    s->u_history[18U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[19U] * v_next_sum_sample);
    v_next_sum_sample = s->u_history[20U];
    s->u_history[19U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[20U] * v_next_sum_sample);
    v_next_sum_sample = s->u_history[21U];
    s->u_history[20U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[21U] * v_next_sum_sample);
    v_next_sum_sample = s->u_history[22U];
    s->u_history[21U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[22U] * v_next_sum_sample);
    v_next_sum_sample = s->u_history[23U];
    s->u_history[22U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[23U] * v_next_sum_sample);
    v_next_sum_sample = u->u;
    s->u_history[23U] = v_next_sum_sample;
    v_next_sum = v_next_sum + (p->command_weight[24U] * v_next_sum_sample);
    /* spec: reference.msnn.yaml:22 */
    uint32_t sets_at = 0U;
    reference_real sets_here;
    reference_real sets_next;
    if (s->v >= 45.0f) {
        sets_at = 5U;
        sets_here = 0.0f;
        sets_next = ((s->v - 45.0f) * 0.0f) + 1.0f;
    } else if (s->v >= (-45.0f)) {
        const reference_real sets_place = (s->v + 45.0f) * 0.06666667f;
        sets_at = (uint32_t)sets_place;
        if (s->v < constants[sets_at]) {
            sets_at = sets_at - 1U;
        }
        sets_here = (constants[sets_at + 1U] - s->v) * 0.06666667f;
        sets_next = (s->v - constants[sets_at]) * 0.06666667f;
    } else {
        sets_here = ((s->v + 45.0f) * 0.0f) + 1.0f;
        sets_next = 0.0f;
    }
    /* spec: next(v) (reference.msnn.yaml:27) */
    const reference_real v_next_part = (sets_here
        * ((p->gain_weight[sets_at] * v_next_sum) + p->gain_bias[sets_at]))
        + (sets_next * ((p->gain_weight[sets_at + 1U] * v_next_sum) + p->gain_bias[sets_at + 1U]));
    const reference_real v_next_part_2 = (v_next_part + 0.0f)
        + (p->p0 * reference_tanh((p->p1 * s->v) + p->p2));
    /* spec: v_next (reference.msnn.yaml:27) */
    const reference_real v_next = s->v + (0.05f * v_next_part_2);
    /* outputs */
    y->v_next = v_next;
    /* next states */
    s->v = v_next;
    if (!(fabsf(s->v) <= 50.0f)) {
        status |= REFERENCE_STATUS_STATE_OUT_OF_RANGE;
    }
    return status;
}
