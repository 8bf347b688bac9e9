/* Filters rows of numbers from stdin: inputs, then measurements, as doubles. Prints, for every
 * hundredth of them, the smallest D of the covariance U D U' so far, statuses that were not 0, and
 * at the end all of U and D. HEADER, PREFIX, OF_REAL, OF_ROWS, OF_INPUTS and OF_MEASURED are given. */
#include HEADER

#include <stdio.h>
#include <stdlib.h>

#define JOINED(a, b) a##b
#define NAMED(a, b) JOINED(a, b)

int main(int count, char **arguments)
{
    static NAMED(PREFIX, _t) e;
    union {
        NAMED(PREFIX, _in_t) in;
        OF_REAL numbers[OF_INPUTS];
    } given;
    union {
        NAMED(PREFIX, _measured_t) in;
        OF_REAL numbers[OF_MEASURED];
    } seen;
    NAMED(PREFIX, _out_t) out;
    OF_REAL start[OF_STATES];
    double row[OF_INPUTS + OF_MEASURED];
    double smallest = 1e300;
    long failed = 0;
    for (int i = 0; i < OF_STATES; i++) {
        start[i] = (OF_REAL)(i + 1 < count ? atof(arguments[i + 1]) : 0);
    }
    NAMED(PREFIX, _reset)(&e, start);
    for (long k = 0; k < OF_ROWS && fread(row, sizeof row, 1, stdin) == 1; k++) {
        for (int i = 0; i < OF_INPUTS; i++) {
            given.numbers[i] = (OF_REAL)row[i];
        }
        for (int i = 0; i < OF_MEASURED; i++) {
            seen.numbers[i] = (OF_REAL)row[OF_INPUTS + i];
        }
        failed += NAMED(PREFIX, _update)(&e, &seen.in, &given.in, &out) != 0;
        for (unsigned i = 0; i < sizeof e.x / sizeof *e.x; i++) {
            smallest = e.factor[i][i] < smallest ? (double)e.factor[i][i] : smallest;
        }
        if ((k + 1) % (OF_ROWS / 100) == 0) {
            printf("%ld %ld %.9g", k + 1, failed, smallest);
            for (unsigned i = 0; i < sizeof e.x / sizeof *e.x; i++) {
                printf(" %.9g", (double)out.x[i]);
            }
            for (unsigned i = 0; i < sizeof e.x / sizeof *e.x; i++) {
                for (unsigned j = i; j < sizeof e.x / sizeof *e.x; j++) {
                    printf(" %.9g", (double)e.factor[i][j]);
                }
            }
            printf("\n");
        }
    }
    return 0;
}
