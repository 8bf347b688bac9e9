/* Step, init and reset of the model `joint_arm`. Made by msnn; do not edit. */
#include "joint_arm.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "joint_arm_math.h"

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
static inline void joint_arm_flagged(
    joint_arm_real x,
    joint_arm_real low,
    joint_arm_real high,
    joint_arm_status_t *status)
{
    if ((x < low) || (x > high)) {
        *status |= JOINT_ARM_STATUS_OUT_OF_RANGE;
    } else {
        *status |= JOINT_ARM_STATUS_NOT_A_NUMBER;
    }
}

/* Initialises the state without history. */
void joint_arm_init(joint_arm_state_t *s, const JOINT_ARM_PLACED joint_arm_params_t *p)
{
    (void)p;
    for (uint32_t i = 0U; i < 3U; i++) {
        for (uint32_t j = 0U; j < 4U; j++) {
            s->q_tape[(i * 4U) + j] = 0.0f;
        }
    }
    s->ready = 6U;
}

/* Initialises the state from a known past; returns what was out of order. */
joint_arm_status_t joint_arm_reset(
    joint_arm_state_t *s,
    const JOINT_ARM_PLACED joint_arm_params_t *p,
    const joint_arm_init_t *x0)
{
    (void)p;
    joint_arm_status_t status = JOINT_ARM_OK;
    for (uint32_t i = 0U; i < 3U; i++) {
        for (uint32_t j = 0U; j < 4U; j++) {
            if (!(fabsf(x0->q[(i * 4U) + j]) <= 3.0f)) {
                joint_arm_flagged(x0->q[(i * 4U) + j], -3.0f, 3.0f, &status);
            }
        }
    }
    for (uint32_t i = 0U; i < 3U; i++) {
        for (uint32_t j = 0U; j < 4U; j++) {
            s->q_tape[(i * 4U) + j] = x0->q[(i * 4U) + j];
        }
    }
    s->ready = 4U;
    for (uint32_t i = 0U; i < 3U; i++) {
        for (uint32_t j = 0U; j < 4U; j++) {
            if (!(fabsf(s->q_tape[(i * 4U) + j]) <= 3.4028235e+38f)) {
                status |= JOINT_ARM_STATUS_STATE_NOT_FINITE;
            }
        }
    }
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
joint_arm_status_t joint_arm_step(
    joint_arm_state_t *s,
    const JOINT_ARM_PLACED joint_arm_params_t *p,
    const joint_arm_in_t *u,
    joint_arm_out_t *y)
{
    joint_arm_status_t status = JOINT_ARM_OK;
    /* inputs */
    if (!(fabsf(u->tau[0U]) <= 5.0f)) {
        joint_arm_flagged(u->tau[0U], -5.0f, 5.0f, &status);
    }
    if (!(fabsf(u->tau[1U]) <= 5.0f)) {
        joint_arm_flagged(u->tau[1U], -5.0f, 5.0f, &status);
    }
    if (!(fabsf(u->tau[2U]) <= 5.0f)) {
        joint_arm_flagged(u->tau[2U], -5.0f, 5.0f, &status);
    }
    if (s->ready != 4U) {
        status |= JOINT_ARM_STATUS_UNINITIALISED;
    }
    joint_arm_real q_next[3];
    joint_arm_real sum = p->own_weight[0U] * s->q_tape[0U];
    sum = sum + (p->own_weight[1U] * s->q_tape[1U]);
    sum = sum + (p->own_weight[2U] * s->q_tape[2U]);
    sum = sum + (p->own_weight[3U] * s->q_tape[3U]);
    const joint_arm_real part = sum
        + (((p->coupling[0U] * u->tau[0U]) + (p->coupling[1U] * u->tau[1U]))
        + (p->coupling[2U] * u->tau[2U]));
    const joint_arm_real part_2 = (joint_arm_sin(s->q_tape[3U] * 1.0f) * p->shape[0U])
        + (joint_arm_sin(s->q_tape[3U] * 2.0f) * p->shape[3U]);
    q_next[0U] = part + part_2;
    joint_arm_real sum_2 = p->own_weight[4U] * s->q_tape[4U];
    sum_2 = sum_2 + (p->own_weight[5U] * s->q_tape[5U]);
    sum_2 = sum_2 + (p->own_weight[6U] * s->q_tape[6U]);
    sum_2 = sum_2 + (p->own_weight[7U] * s->q_tape[7U]);
    const joint_arm_real part_3 = sum_2
        + (((p->coupling[3U] * u->tau[0U]) + (p->coupling[4U] * u->tau[1U]))
        + (p->coupling[5U] * u->tau[2U]));
    const joint_arm_real part_4 = (joint_arm_sin(s->q_tape[7U] * 1.0f) * p->shape[1U])
        + (joint_arm_sin(s->q_tape[7U] * 2.0f) * p->shape[4U]);
    q_next[1U] = part_3 + part_4;
    joint_arm_real sum_3 = p->own_weight[8U] * s->q_tape[8U];
    sum_3 = sum_3 + (p->own_weight[9U] * s->q_tape[9U]);
    sum_3 = sum_3 + (p->own_weight[10U] * s->q_tape[10U]);
    sum_3 = sum_3 + (p->own_weight[11U] * s->q_tape[11U]);
    const joint_arm_real part_5 = sum_3
        + (((p->coupling[6U] * u->tau[0U]) + (p->coupling[7U] * u->tau[1U]))
        + (p->coupling[8U] * u->tau[2U]));
    const joint_arm_real part_6 = (joint_arm_sin(s->q_tape[11U] * 1.0f) * p->shape[2U])
        + (joint_arm_sin(s->q_tape[11U] * 2.0f) * p->shape[5U]);
    q_next[2U] = part_5 + part_6;
    joint_arm_real part_7[3];
    part_7[0U] = -q_next[1U];
    part_7[1U] = -q_next[2U];
    part_7[2U] = q_next[0U];
    /* outputs */
    y->q_next[0U] = q_next[0U];
    y->q_next[1U] = q_next[1U];
    y->q_next[2U] = q_next[2U];
    y->q_shown[0U] = (fabsf(q_next[0U]) > 0.5f) ? part_7[0U] : q_next[0U];
    y->q_shown[1U] = (fabsf(q_next[1U]) > 0.5f) ? part_7[1U] : q_next[1U];
    y->q_shown[2U] = (fabsf(q_next[2U]) > 0.5f) ? part_7[2U] : q_next[2U];
    /* next states */
    for (uint32_t i = 0U; i < 3U; i++) {
        for (uint32_t j = 0U; j < 3U; j++) {
            s->q_tape[(i * 4U) + j] = s->q_tape[((i * 4U) + j) + 1U];
        }
    }
    s->q_tape[3U] = q_next[0U];
    s->q_tape[7U] = q_next[1U];
    s->q_tape[11U] = q_next[2U];
    if (!(fabsf(s->q_tape[3U]) <= 3.4028235e+38f)) {
        status |= JOINT_ARM_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->q_tape[7U]) <= 3.4028235e+38f)) {
        status |= JOINT_ARM_STATUS_STATE_NOT_FINITE;
    }
    if (!(fabsf(s->q_tape[11U]) <= 3.4028235e+38f)) {
        status |= JOINT_ARM_STATUS_STATE_NOT_FINITE;
    }
    return status;
}
