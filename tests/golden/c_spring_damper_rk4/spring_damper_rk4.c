/* Step, init and reset of the model `spring_damper_rk4`. Made by msnn; do not edit. */
#include "spring_damper_rk4.h"

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
static inline void spring_damper_rk4_flagged(
    spring_damper_rk4_real x,
    spring_damper_rk4_real low,
    spring_damper_rk4_real high,
    spring_damper_rk4_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= SPRING_DAMPER_RK4_STATUS_OUT_OF_RANGE;
    } else {
        *status |= SPRING_DAMPER_RK4_STATUS_NOT_A_NUMBER;
    }
}

/* Initialises the state without history. */
void spring_damper_rk4_init(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p)
{
    s->v = p->v_start;
    s->x = 0.0f;
    s->ready = 6U;
}

/* Initialises the state from a known past; returns what was out of order. */
spring_damper_rk4_status_t spring_damper_rk4_reset(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p,
    const spring_damper_rk4_init_t *x0)
{
    spring_damper_rk4_status_t status = SPRING_DAMPER_RK4_OK;
    if (!(fabsf(x0->x_meas) <= 3.4028235e+38f)) {
        spring_damper_rk4_flagged(x0->x_meas, -3.4028235e+38f, 3.4028235e+38f, &status);
    }
    s->x = x0->x_meas;
    s->v = p->v_start;
    s->ready = 4U;
    if (!(fabsf(s->x) <= 3.4028235e+38f)) {
        status |= SPRING_DAMPER_RK4_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->v) <= 3.4028235e+38f)) {
        status |= SPRING_DAMPER_RK4_STATUS_STATE_NOT_FINITE;
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
spring_damper_rk4_status_t spring_damper_rk4_step(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p,
    const spring_damper_rk4_in_t *u,
    spring_damper_rk4_out_t *y)
{
    spring_damper_rk4_status_t status = SPRING_DAMPER_RK4_OK;
    /* inputs */
    if (!(fabsf(u->F) <= 10.0f)) {
        spring_damper_rk4_flagged(u->F, -10.0f, 10.0f, &status);
    }
    if (s->ready != 4U) {
        status |= SPRING_DAMPER_RK4_STATUS_UNINITIALISED;
    }
    const spring_damper_rk4_real part = p->stiffness * s->x;
    const spring_damper_rk4_real part_2 = (u->F - ((p->damping * s->v) + part)) / p->mass;
    const spring_damper_rk4_real part_3 = s->v + (0.025f * part_2);
    const spring_damper_rk4_real part_4 = u->F
        - ((p->damping * part_3) + (p->stiffness * (s->x + (0.025f * s->v))));
    const spring_damper_rk4_real part_5 = part_4 / p->mass;
    const spring_damper_rk4_real part_6 = s->v + (0.025f * part_5);
    const spring_damper_rk4_real part_7 = u->F
        - ((p->damping * part_6) + (p->stiffness * (s->x + (0.025f * part_3))));
    const spring_damper_rk4_real part_8 = part_7 / p->mass;
    const spring_damper_rk4_real part_9 = s->v + (0.05f * part_8);
    /* outputs */
    y->position = s->x;
    y->spring_force = part;
    /* next states */
    const spring_damper_rk4_real x_next = s->x
        + (0.008333334f * ((s->v + (2.0f * (part_3 + part_6))) + part_9));
    const spring_damper_rk4_real part_10 = u->F
        - ((p->damping * part_9) + (p->stiffness * (s->x + (0.05f * part_6))));
    const spring_damper_rk4_real part_11 = 0.008333334f
        * ((part_2 + (2.0f * (part_5 + part_8))) + (part_10 / p->mass));
    const spring_damper_rk4_real v_next = s->v + part_11;
    s->x = x_next;
    s->v = v_next;
    if (!(fabsf(s->x) <= 3.4028235e+38f)) {
        status |= SPRING_DAMPER_RK4_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->v) <= 3.4028235e+38f)) {
        status |= SPRING_DAMPER_RK4_STATUS_STATE_NOT_FINITE;
    }
    return status;
}
