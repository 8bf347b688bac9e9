/* Solves from drawn numbers, some of them infinite, NaN or huge, and looks whether anything is
 * wrong: a status that cannot be, a plan called solved that is not, controls that are not numbers
 * or outside their limits, memory beside the struct. Prints how often each status came. */
#include HEADER

#include <math.h>
#include <stdio.h>
#include <string.h>

#define JOINED(a, b) a##b
#define NAME(a, b) JOINED(a, b)
#define CALL(name) NAME(PREFIX, name)

static unsigned long long seed = 88172645463325252ULL;

static double drawn(void)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return (double)(seed >> 11) / 9007199254740992.0;
}

static double number(void)
{
    const double kind = drawn();
    if (kind < 0.002) return (double)NAN;
    if (kind < 0.004) return (double)INFINITY;
    if (kind < 0.006) return -(double)INFINITY;
    if (kind < 0.02) return 1e30 * (drawn() - 0.5);
    if (kind < 0.05) return 1e6 * (drawn() - 0.5);
    if (kind < 0.1) return 0.0;
    if (kind < 0.5) return 20.0 * (drawn() - 0.5);
    return 2.0 * (drawn() - 0.5);
}

int main(void)
{
    static struct {
        unsigned char before[64];
        CALL(_t) controller;
        unsigned char after[64];
    } memory;
    int counts[5] = {0};
    int wrong = 0;
    memset(&memory, 0xA5, sizeof memory);
    CALL(_init)(&memory.controller);
    for (int i = 0; i < SOLVES; i++) {
        CALL(_in_t) in;
        CALL(_out_t) out;
        REAL numbers[sizeof in / sizeof(REAL)];
        int finite = 1;
        for (unsigned k = 0; k < sizeof numbers / sizeof numbers[0]; k++) {
            numbers[k] = (REAL)number();
            finite &= isfinite(numbers[k]) != 0;
        }
        memcpy(&in, numbers, sizeof in);
        if (i % 50 == 0) CALL(_init)(&memory.controller);
        int status;
        if (i % 7 == 6) {
            CALL(_prepare)(&memory.controller);
            status = CALL(_feedback)(&memory.controller, &in, &out);
        } else {
            status = CALL(_solve)(&memory.controller, &in, &out);
        }
        if (status < 0 || status > 3) {
            wrong |= 1;
            continue;
        }
        counts[status]++;
        if (!finite && status != 3) wrong |= 2;
        if (status == 0 && !(out.residual <= OF_TOLERANCE)) wrong |= 4;
        for (unsigned k = 0; k < sizeof out.u / sizeof out.u[0]; k++) {
            if (!(out.u[k] >= (REAL)OF_LOWEST && out.u[k] <= (REAL)OF_HIGHEST)) wrong |= 8;
        }
        for (int k = 0; k < 64; k++) {
            if (memory.before[k] != 0xA5 || memory.after[k] != 0xA5) wrong |= 16;
        }
    }
    printf("%d %d %d %d\n", counts[0], counts[1], counts[2], counts[3]);
    return wrong;
}
