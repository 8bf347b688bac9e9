#include "model_math.h"

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
double model_tanh(double x)
{
    const double size = fabs(x);
    double result;
    if (size < 0x1.199999999999ap-1) {
        const double t1 = x * x;
        const double t2 = (t1 * 0x1.abe963b461576p-15) - 0x1.b9013d8ff2ca7p-13;
        const double t3 = (((t2 * t1) + 0x1.2fa13eb8c14b3p-11) * t1) - 0x1.7cf38633f6a1dp-10;
        const double t4 = (((t3 * t1) + 0x1.d6c6181d3e37bp-9) * t1) - 0x1.226ddd1baa4eep-7;
        const double t5 = (((t4 * t1) + 0x1.664f45c131aaep-6) * t1) - 0x1.ba1ba1ad6881ep-5;
        const double t6 = (((t5 * t1) + 0x1.11111111028b9p-3) * t1) - 0x1.5555555555274p-4;
        result = x + (x * (((t1 * t6) - (0.25 * t1)) + 0.0));
    } else {
        double outer;
        if (size <= 0x1.30fc1931f09c9p+4) {
            const double t7 = size + size;
            const double count = ((t7 * 0x1.71547652b82fep+0) + 0x1.8p+52) - 0x1.8p+52;
            const double high = t7 - (count * 0x1.62e42fefa38p-1);
            const double low = count * 0x1.ef35793c7673p-45;
            const double r = high - low;
            const double t8 = (r * 0x1.adc31bbd06cbcp-26) + 0x1.28aef55949d45p-22;
            const double t9 = (((t8 * r) + 0x1.71df002a8290cp-19) * r) + 0x1.a01998760747ep-16;
            const double t10 = (((t9 * r) + 0x1.a01a01385f82ap-13) * r) + 0x1.6c16c184bbd53p-10;
            const double t11 = (((t10 * r) + 0x1.1111111125a9ep-7) * r) + 0x1.55555555505f4p-5;
            const double t12 = (((t11 * r) + 0x1.55555555555p-3) * r) + 0x1.000000000000ap-1;
            const double tail = ((r * r) * t12) + ((high - r) - low);
            const double s = r + tail;
            const uint32_t t13 = (uint32_t)count;
            const uint32_t t14 = t13 >> 1U;
            const uint32_t t15 = (uint32_t)1U << t14;
            const uint32_t t16 = (uint32_t)1U << (t13 - t14);
            const double power = (double)t15 * (double)t16;
            outer = 1.0 - (2.0 / ((power + 1.0) + (power * s)));
        } else {
            outer = (size > 0x1.30fc1931f09c9p+4) ? 1.0 : x;
        }
        result = (x < 0.0) ? (-outer) : outer;
    }
    return result;
}
