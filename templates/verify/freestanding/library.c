/* What a C library would bring: four functions on bytes, and square roots that round correctly. */
#include <math.h>
#include <stdint.h>
#include <string.h>

void *memcpy(void *to, const void *from, size_t count)
{
    char *target = to;
    const char *source = from;
    for (size_t i = 0U; i < count; i++) {
        target[i] = source[i];
    }
    return to;
}

void *memset(void *to, int value, size_t count)
{
    char *target = to;
    for (size_t i = 0U; i < count; i++) {
        target[i] = (char)value;
    }
    return to;
}

void *memmove(void *to, const void *from, size_t count)
{
    char *target = to;
    const char *source = from;
    if (target < source) {
        return memcpy(to, from, count);
    }
    for (size_t i = count; i > 0U; i--) {
        target[i - 1U] = source[i - 1U];
    }
    return to;
}

size_t strlen(const char *text)
{
    size_t length = 0U;
    while (text[length] != '\0') {
        length++;
    }
    return length;
}

/* Digit by digit: the remainder says which way to round, and a root is never half-way. */
float sqrtf(float x)
{
#if defined(__riscv_flen)
    float root;
    __asm("fsqrt.s %0, %1" : "=f"(root) : "f"(x));
    return root;
#else
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    if (!(x > 0.0f)) {
        return (x < 0.0f) ? NAN : x;
    }
    if (bits == 0x7F800000U) {
        return x;
    }
    int32_t exponent = (int32_t)(bits >> 23U) - 127;
    uint32_t fraction = bits & 0x7FFFFFU;
    if (exponent == -127) {
        exponent = -126;
        while ((fraction & 0x800000U) == 0U) {
            fraction <<= 1U;
            exponent--;
        }
    } else {
        fraction |= 0x800000U;
    }
    if ((exponent & 1) != 0) {
        fraction <<= 1U;
        exponent--;
    }
    /* the root of fraction * 2^25 has 25 bits, the last of which rounds */
    uint64_t rest = (uint64_t)fraction << 25U;
    uint64_t root = 0U;
    for (uint64_t digit = (uint64_t)1U << 48U; digit != 0U; digit >>= 2U) {
        if (rest >= (root + digit)) {
            rest -= root + digit;
            root = (root >> 1U) + digit;
        } else {
            root >>= 1U;
        }
    }
    const uint32_t rounded = (uint32_t)((root + 1U) >> 1U);
    bits = ((uint32_t)((exponent / 2) + 126) << 23U) + rounded;
    memcpy(&x, &bits, sizeof x);
    return x;
#endif
}

/* The same for doubles: 53 digits and one that rounds, two digits of the number at a time. */
double sqrt(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    if (!(x > 0.0)) {
        return (x < 0.0) ? (double)NAN : x;
    }
    if (bits == ((uint64_t)0x7FFU << 52U)) {
        return x;
    }
    int32_t exponent = (int32_t)(bits >> 52U) - 1023;
    uint64_t fraction = bits & (((uint64_t)1U << 52U) - 1U);
    const uint64_t leading = (uint64_t)1U << 52U;
    if (exponent == -1023) {
        exponent = -1022;
        while ((fraction & leading) == 0U) {
            fraction <<= 1U;
            exponent--;
        }
    } else {
        fraction |= leading;
    }
    if ((exponent & 1) != 0) {
        fraction <<= 1U;
        exponent--;
    }
    /* 54 binary digits before those that are 0 */
    fraction <<= 10U;
    uint64_t rest = 0U;
    uint64_t root = 0U;
    for (int digit = 0; digit < 54; digit++) {
        rest = (rest << 2U) | (fraction >> 62U);
        fraction <<= 2U;
        const uint64_t trial = (root << 2U) | 1U;
        root <<= 1U;
        if (rest >= trial) {
            rest -= trial;
            root |= 1U;
        }
    }
    const uint64_t rounded = (root + 1U) >> 1U;
    bits = ((uint64_t)(uint32_t)((exponent / 2) + 1022) << 52U) + rounded;
    memcpy(&x, &bits, sizeof x);
    return x;
}
