/* Counts how far float results are from those of the double-precision functions. */
#ifndef COMPARE_H
#define COMPARE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

struct record {
    unsigned long long compared;
    unsigned long long wrong;
    unsigned long long broken;
    double largest;
    float largest_at[2];
    float broken_at[2];
};

static inline float from_bits(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* 1 / (unit in the last place) of the float format at |exact|, which is below overflow. */
static inline double inverse_unit(double exact)
{
    uint64_t bits;
    memcpy(&bits, &exact, sizeof bits);
    int exponent = (int)((bits >> 52) & 0x7FFU) - 1023;
    if (exponent < -126) {
        exponent = -126;
    }
    bits = (uint64_t)(1023 - exponent + 23) << 52;
    double result;
    memcpy(&result, &bits, sizeof result);
    return result;
}

/* NaN belongs to NaN and infinity to infinity; where `exact` rounds to infinity by less than a
 * unit the largest float will do; a zero keeps its sign. */
static inline bool is_broken(float value, double exact)
{
    const float rounded = (float)exact;
    if (isnan(exact)) {
        return !isnan(value);
    }
    if (isinf(rounded)) {
        const bool next = (fabs(exact) < 0x1.000001p128) && (fabsf(value) == 0x1.fffffep127f);
        return (value != rounded) && !next;
    }
    return isnan(value) || ((value == rounded) && (signbit(value) != signbit(rounded)));
}

static inline void compare(struct record *record, float value, double exact, float x, float y)
{
    if (is_broken(value, exact)) {
        record->broken++;
        record->broken_at[0] = x;
        record->broken_at[1] = y;
    } else if (isfinite((float)exact)) {
        const double error = fabs((double)value - exact) * inverse_unit(exact);
        record->compared++;
        record->wrong += (value != (float)exact);
        if (error > record->largest) {
            record->largest = error;
            record->largest_at[0] = x;
            record->largest_at[1] = y;
        }
    }
}

static inline void print_record(const struct record *record)
{
    printf("%llu %llu %llu %a %a %a %a %a\n", record->compared, record->wrong, record->broken,
           record->largest, (double)record->largest_at[0], (double)record->largest_at[1],
           (double)record->broken_at[0], (double)record->broken_at[1]);
}

#endif
