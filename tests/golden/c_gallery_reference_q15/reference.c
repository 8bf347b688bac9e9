/* Step, init and reset of the model `reference`. Made by msnn; do not edit. */
#include "reference.h"

#include <stdint.h>

/* x moved to the nearest limit. */
static inline reference_sum_t reference_limited(
    reference_sum_t x,
    reference_sum_t low,
    reference_sum_t high)
{
    const reference_sum_t above = (x > low) ? x : low;
    return (above < high) ? above : high;
}

/* x / 2^14, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_14(reference_sum_t x)
{
    const reference_sum_t raised = x + 8192;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 16383U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 16384;
}

/* x / 2^15, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_15(reference_sum_t x)
{
    const reference_sum_t raised = x + 16384;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 32767U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 32768;
}

/* x / 2^9, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_9(reference_sum_t x)
{
    const reference_sum_t raised = x + 256;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 511U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 512;
}

/* The straight line between two values of a table whose cells are 2^9 wide. */
static inline reference_sum_t reference_interpolated_9(
    const REFERENCE_PLACED reference_word_t *table,
    reference_sum_t distance)
{
    const uint32_t place = (uint32_t)distance;
    const uint32_t cell = place >> 9U;
    const uint32_t inside = place & 511U;
    const reference_sum_t part = (reference_sum_t)inside;
    const reference_sum_t left = (reference_sum_t)table[cell];
    const reference_sum_t right = (reference_sum_t)table[cell + 1U];
    return left + reference_rounded_9((right - left) * part);
}

/* x / 2^16, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_16(reference_sum_t x)
{
    const reference_sum_t raised = x + 32768;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 65535U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 65536;
}

/* x / 2^5, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_5(reference_sum_t x)
{
    const reference_sum_t raised = x + 16;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 31U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 32;
}

/* x / 2^2, rounded to the nearest number, halves upwards. */
static inline reference_sum_t reference_rounded_2(reference_sum_t x)
{
    const reference_sum_t raised = x + 2;
    const uint32_t pattern = (uint32_t)raised;
    const uint32_t low_bits = pattern & 3U;
    const reference_sum_t rest = (reference_sum_t)low_bits;
    return (raised - rest) / 4;
}

/* Initialises the state without history. */
void reference_init(reference_state_t *s)
{
    s->v = 0;
    for (uint32_t i = 0U; i < 24U; i++) {
        s->u_history[i] = (reference_word_t)0;
    }
    s->ready = 7U;
}

/* Initialises the state from a known past; returns what was out of order. */
reference_status_t reference_reset(reference_state_t *s, const reference_init_t *x0)
{
    reference_status_t status = REFERENCE_OK;
    reference_word_t w_u[24];
    for (uint32_t i = 0U; i < 24U; i++) {
        w_u[i] = (reference_word_t)reference_limited((reference_sum_t)x0->u[i], -20480, 20480);
        if (w_u[i] != x0->u[i]) {
            status |= REFERENCE_STATUS_CLAMPED;
        }
    }
    reference_word_t w_v[1];
    for (uint32_t i = 0U; i < 1U; i++) {
        w_v[i] = (reference_word_t)reference_limited((reference_sum_t)x0->v[i], -25600, 25600);
        if (w_v[i] != x0->v[i]) {
            status |= REFERENCE_STATUS_CLAMPED;
        }
    }
    /* spec: model.msnn.yaml:28 */
    const reference_sum_t n1 = 16384 * ((reference_sum_t)w_v[0U]);
    s->v = n1;
    for (uint32_t i = 0U; i < 24U; i += 4U) {
        s->u_history[i] = w_u[i];
        s->u_history[i + 1U] = w_u[i + 1U];
        s->u_history[i + 2U] = w_u[i + 2U];
        s->u_history[i + 3U] = w_u[i + 3U];
    }
    s->ready = 4U;
    return status;
}

/* Computes the outputs of sample t, then the states of sample t+1. */
reference_status_t reference_step(
    reference_state_t *s,
    const reference_in_t *u,
    reference_out_t *y)
{
    reference_status_t status = REFERENCE_OK;
    const reference_word_t w_u = (reference_word_t)reference_limited((reference_sum_t)u->u, -20480,
        20480);
    if (w_u != u->u) {
        status |= REFERENCE_STATUS_CLAMPED;
    }
    if (s->ready != 4U) {
        if ((s->ready & 6U) != 4U) {
            status |= REFERENCE_STATUS_UNINITIALISED;
        }
        if ((s->ready & 1U) != 0U) {
            for (uint32_t i = 0U; i < 24U; i++) {
                s->u_history[i] = w_u;
            }
            s->ready = s->ready & 6U;
        }
    }
    /* spec: model.msnn.yaml:27 */
    const reference_sum_t n1 = reference_rounded_14(s->v);
    const reference_sum_t n2 = 6710886 + (20972 * n1);
    const reference_sum_t n3 = reference_rounded_15(n2);
    const reference_sum_t n5 = (n3 > (-16139)) ? n3 : (-16139);
    const reference_sum_t n7 = (n5 < 16539) ? n5 : 16539;
    static const REFERENCE_PLACED reference_word_t table_1[66] = {
        -32746, -32740, -32732, -32722, -32709, -32692, -32670, -32642, -32607, -32561, -32502,
        -32427, -32331, -32208, -32051, -31850, -31594, -31268, -30854, -30330, -29670, -28843,
        -27812, -26537, -24976, -23088, -20837, -18197, -15166, -11762, -8040, -4082, 0, 4082, 8040,
        11762, 15166, 18197, 20837, 23088, 24976, 26537, 27812, 28843, 29670, 30330, 30854, 31268,
        31594, 31850, 32051, 32208, 32331, 32427, 32502, 32561, 32607, 32642, 32670, 32692, 32709,
        32722, 32732, 32740, 32746, 32751
    };
    const reference_sum_t n8 = reference_interpolated_9(table_1, n7 - (-16384));
    reference_sum_t n34 = 2621 * ((reference_sum_t)w_u);
    for (uint32_t i = 0U; i < 24U; i += 4U) {
        n34 = n34 + (2621 * ((reference_sum_t)s->u_history[i]));
        n34 = n34 + (2621 * ((reference_sum_t)s->u_history[i + 1U]));
        n34 = n34 + (2621 * ((reference_sum_t)s->u_history[i + 2U]));
        n34 = n34 + (2621 * ((reference_sum_t)s->u_history[i + 3U]));
    }
    const reference_sum_t n35 = reference_rounded_16(n34);
    const reference_sum_t n36 = (-(3277 * n8)) + (31457 * n35);
    const reference_sum_t n37 = reference_rounded_5(n36);
    const reference_sum_t n38 = (4 * s->v) + n37;
    const reference_sum_t n39 = reference_rounded_16(n38);
    const reference_sum_t n40 = reference_rounded_2(n38);
    y->v_next = (reference_word_t)n39;
    s->v = reference_limited(n40, -419430400, 419430400);
    if (s->v != n40) {
        status |= REFERENCE_STATUS_STATE_SATURATED;
    }
    for (uint32_t i = 0U; i < 20U; i += 4U) {
        s->u_history[i] = s->u_history[i + 1U];
        s->u_history[i + 1U] = s->u_history[i + 2U];
        s->u_history[i + 2U] = s->u_history[i + 3U];
        s->u_history[i + 3U] = s->u_history[i + 4U];
    }
    s->u_history[20U] = s->u_history[21U];
    s->u_history[21U] = s->u_history[22U];
    s->u_history[22U] = s->u_history[23U];
    s->u_history[23U] = w_u;
    return status;
}
