/* Compares one float kernel of two arguments with the double function on stratified pairs.
 *
 * Built with -DKERNEL=<function under test> -DREFERENCE=<double function>, and -DIS_POWER=1 for
 * pow; the argument is the number of pairs. A quarter of them are any two bit patterns, a quarter
 * has sizes between 2^-16 and 2^16, a quarter are small fractions and whole numbers, and a quarter
 * is drawn so that results fill the range of the format (for pow) or that the arguments are alike.
 * Prints the record.
 */
#include "compare.h"
#include "splitmix64.h"

#include <stdlib.h>

float KERNEL(float x, float y);

static float usual(uint32_t bits)
{
    const float fraction = 1.0f + (float)(bits & 0x7FFFFFU) * 0x1p-23f;
    const float size = ldexpf(fraction, (int)((bits >> 23) & 31U) - 16);
    return ((bits >> 31) != 0U) ? -size : size;
}

static float short_number(uint32_t bits)
{
    return (float)((int)(bits & 0xFFFFU) - 0x8000) * (((bits >> 16) & 1U) ? 0x1p-8f : 1.0f);
}

static void draw(uint64_t index, float *x, float *y)
{
    const uint64_t bits = next();
    const uint32_t first = (uint32_t)bits;
    const uint32_t second = (uint32_t)(bits >> 32);
    if ((index & 3U) == 0U) {
        *x = from_bits(first);
        *y = from_bits(second);
    } else if ((index & 3U) == 1U) {
        *x = usual(first);
        *y = usual(second);
    } else if ((index & 3U) == 2U) {
        *x = short_number(first);
        *y = short_number(second);
    } else if (IS_POWER) {
        *x = ((index & 4U) == 0U) ? fabsf(usual(first)) : 1.0f + usual(first) * 0x1p-20f;
        const double target = -105.0 + (double)second * (195.0 / 0x1p32);
        *y = (float)(target / log((double)*x));
    } else {
        *x = from_bits(first);
        *y = *x * (1.0f + 0.5f * usual(second));
    }
}

int main(int count, char **arguments)
{
    const uint64_t pairs = (count > 1) ? strtoull(arguments[1], NULL, 10) : 1000000000U;
    struct record record = {0};
    for (uint64_t index = 0; index < pairs; index++) {
        float x;
        float y;
        draw(index, &x, &y);
        compare(&record, KERNEL(x, y), REFERENCE((double)x, (double)y), x, y);
    }
    print_record(&record);
    return 0;
}
