#include "reference_math.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __FAST_MATH__
#error these functions need IEEE 754 arithmetic
#endif

#ifdef FLT_EVAL_METHOD
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error these functions need every operation rounded to the type of its operands
#endif
#endif

/* gcc does not know the pragma: -ffp-contract=off is its flag */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

/* Hyperbolic tangent. */
float reference_tanh(float x)
{
    const float size = fabsf(x);
    float result;
    if (size < 0x1.d70a3ep-1f) {
        const float t1 = x * x;
        const float t2 = ((t1 * (-0x1.a9803ep-12f)) + 0x1.40aa7ep-9f) * t1;
        const float t3 = (((t2 - 0x1.0a0e96p-7f) * t1) + 0x1.61b2cep-6f) * t1;
        const float t4 = (((t3 - 0x1.b9a0bcp-5f) * t1) + 0x1.110dfep-3f) * t1;
        const float t5 = ((t1 * (t4 - 0x1.55552p-4f)) - (0.25f * t1)) + 0.0f;
        result = x + (x * t5);
    } else {
        float outer;
        if (size <= 0x1.205966p+3f) {
            const float t6 = size + size;
            const float count = ((t6 * 0x1.715476p+0f) + 0x1.8p+23f) - 0x1.8p+23f;
            const float high = t6 - (count * 0x1.62e4p-1f);
            const float low = count * 0x1.7f7d1cp-20f;
            const float r = high - low;
            const float t7 = (((r * 0x1.6ab6cp-10f) + 0x1.123d5cp-7f) * r) + 0x1.55585ap-5f;
            const float t8 = (((t7 * r) + 0x1.55548cp-3f) * r) + 0x1.fffffcp-2f;
            const float tail = ((r * r) * t8) + ((high - r) - low);
            const float s = r + tail;
            const uint32_t t9 = (uint32_t)1U << (uint32_t)count;
            const float power = (float)t9;
            outer = 1.0f - (2.0f / ((power + 1.0f) + (power * s)));
        } else {
            outer = (size > 0x1.205966p+3f) ? 1.0f : x;
        }
        result = (x < 0.0f) ? (-outer) : outer;
    }
    return result;
}
