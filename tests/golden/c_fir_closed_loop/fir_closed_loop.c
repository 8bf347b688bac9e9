/* Step, init and reset of the model `fir_closed_loop`. Made by msnn; do not edit. */
#include "fir_closed_loop.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

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
static inline void fir_closed_loop_flagged(
    fir_closed_loop_real x,
    fir_closed_loop_real low,
    fir_closed_loop_real high,
    fir_closed_loop_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= FIR_CLOSED_LOOP_STATUS_OUT_OF_RANGE;
    } else {
        *status |= FIR_CLOSED_LOOP_STATUS_NOT_A_NUMBER;
    }
}

/* Initialises the state without history. */
void fir_closed_loop_init(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p)
{
    (void)p;
    for (uint32_t i = 0U; i < 5U; i++) {
        s->x_tape[i] = 0.0f;
    }
    s->ready = 6U;
}

/* Initialises the state from a known past; returns what was out of order. */
fir_closed_loop_status_t fir_closed_loop_reset(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p,
    const fir_closed_loop_init_t *x0)
{
    (void)p;
    fir_closed_loop_status_t status = FIR_CLOSED_LOOP_OK;
    for (uint32_t i = 0U; i < 5U; i++) {
        if (!(fabsf(x0->x[i]) <= 5.0f)) {
            fir_closed_loop_flagged(x0->x[i], -5.0f, 5.0f, &status);
        }
    }
    for (uint32_t i = 0U; i < 5U; i++) {
        s->x_tape[i] = x0->x[i];
    }
    s->ready = 4U;
    for (uint32_t i = 0U; i < 5U; i++) {
        if (!(fabsf(s->x_tape[i]) <= 3.4028235e+38f)) {
            status |= FIR_CLOSED_LOOP_STATUS_STATE_NOT_FINITE;
        }
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
fir_closed_loop_status_t fir_closed_loop_step(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p,
    const fir_closed_loop_in_t *u,
    fir_closed_loop_out_t *y)
{
    fir_closed_loop_status_t status = FIR_CLOSED_LOOP_OK;
    /* inputs */
    if (!(fabsf(u->F) <= 10.0f)) {
        fir_closed_loop_flagged(u->F, -10.0f, 10.0f, &status);
    }
    if (s->ready != 4U) {
        status |= FIR_CLOSED_LOOP_STATUS_UNINITIALISED;
    }
    fir_closed_loop_real sum = -0.0f;
    for (uint32_t i = 0U; i < 5U; i++) {
        sum = sum + (p->h_weight[i] * s->x_tape[i]);
    }
    const fir_closed_loop_real x_next = sum + (p->g_weight[0U] * u->F);
    /* outputs */
    y->x_next = x_next;
    /* next states */
    s->x_tape[0U] = s->x_tape[1U];
    s->x_tape[1U] = s->x_tape[2U];
    s->x_tape[2U] = s->x_tape[3U];
    s->x_tape[3U] = s->x_tape[4U];
    s->x_tape[4U] = x_next;
    if (!(fabsf(s->x_tape[4U]) <= 3.4028235e+38f)) {
        status |= FIR_CLOSED_LOOP_STATUS_STATE_NOT_FINITE;
    }
    return status;
}
