/* Compares one float kernel of one argument with the double function on every float.
 *
 * Built with -DKERNEL=<function under test> -DREFERENCE=<double function>; the argument is the step
 * from float to float, 1 for all. Prints the record.
 */
#include "compare.h"

#include <stdlib.h>

float KERNEL(float x);

double sigmoid(double x);
double softplus(double x);

double sigmoid(double x)
{
    const double small = exp(-fabs(x));
    return (x >= 0.0) ? (1.0 / (1.0 + small)) : (small / (1.0 + small));
}

double softplus(double x)
{
    return fmax(x, 0.0) + log1p(exp(-fabs(x)));
}

int main(int count, char **arguments)
{
    const uint64_t step = (count > 1) ? strtoull(arguments[1], NULL, 10) : 1U;
    struct record record = {0};
    for (uint64_t bits = 0; bits <= 0xFFFFFFFFU; bits += step) {
        const float x = from_bits((uint32_t)bits);
        compare(&record, KERNEL(x), REFERENCE((double)x), x, 0.0f);
    }
    print_record(&record);
    return 0;
}
