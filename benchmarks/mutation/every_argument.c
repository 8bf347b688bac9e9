/* Looks for an argument at which a changed function gives another result than the right one.
 *
 * Includes what every_argument.py writes: the right function, its changed copies, the corners.
 * Arguments: `every` or `corners`, the first and the last pattern of bits that an argument has; or
 * `drawn` or `beside`, where the first argument is a given one, how many blocks, and the ends of the
 * domain of each argument. Prints the number of each change that shows, and where. A
 * copy that leaves its tables and crashes has shown itself.
 */
#define _POSIX_C_SOURCE 200809L
#include "changes.h"
#include "../kernel_accuracy/splitmix64.h"

#include <setjmp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

static bool shown[CHANGES];
static sigjmp_buf crashed;

static real from_bits(word pattern)
{
    real value;
    memcpy(&value, &pattern, sizeof value);
    return value;
}

static double between(double low, double high)
{
    return low + ((high - low) * ((double)(next() >> 11) * 0x1p-53));
}

/* Within the domain, evenly over the binades around 1, or any bits. */
static real drawn(uint64_t kind, const double *domain)
{
    if (kind == 0U) {
        return (real)between(domain[0], domain[1]);
    }
    if (kind == 1U) {
        const double size = exp2(between(-30.0, 12.0));
        return (real)(((next() >> 63) != 0U) ? -size : size);
    }
    return from_bits((word)next());
}

static void leave_copy(int which)
{
    (void)which;
    siglongjmp(crashed, 1);
}

/* Whether a copy differs somewhere in the block, or crashes. */
static bool differs_or_crashes(int change)
{
    return (sigsetjmp(crashed, 1) != 0) || differs[change]();
}

static bool differs_or_crashes_at(int change, int at)
{
    return (sigsetjmp(crashed, 1) != 0) || (differs_at[change](at) != 0U);
}

/* The changes that gave some statement of the right function another value in this block, and did
 * not show before: of others no result differs. */
static void try_block(void)
{
    (void)memset(noted, 0, sizeof noted);
    take_right();
    for (int change = 0; change < CHANGES; change++) {
        if (shown[change] || (noted[change] == 0U) || !differs_or_crashes(change)) {
            continue;
        }
        int at = 0;
        while ((at < BLOCK) && !differs_or_crashes_at(change, at)) {
            at++;
        }
        /* what stands beyond a table may be another number each time */
        if (at < BLOCK) {
            shown[change] = true;
            (void)printf("%d %a %a\n", change, (double)x[at], (double)y[at]);
            (void)fflush(stdout);
        }
    }
}

static void try_corners(word first_bits, word last_bits)
{
    const int seconds = (ARITY == 1) ? 1 : CORNERS;
    int filled = 0;
    for (int first = 0; first < CORNERS; first++) {
        if ((bits(corners[first]) < first_bits) || (bits(corners[first]) > last_bits)) {
            continue;
        }
        for (int second = 0; second < seconds; second++) {
            x[filled] = corners[first];
            y[filled] = corners[second];
            filled++;
            if (filled == BLOCK) {
                try_block();
                filled = 0;
            }
        }
    }
    /* what is left over meets 1 */
    while (filled < BLOCK) {
        x[filled] = (real)1.0;
        y[filled] = (real)1.0;
        filled++;
    }
    try_block();
}

static void try_every(uint64_t first, uint64_t last, real second)
{
    for (uint64_t pattern = first; pattern <= last; pattern += BLOCK) {
        for (int i = 0; i < BLOCK; i++) {
            const uint64_t here = pattern + (uint64_t)i;
            x[i] = from_bits((word)((here <= last) ? here : last));
            y[i] = second;
        }
        try_block();
    }
}

int main(int count, char **arguments)
{
    const struct sigaction guard = {.sa_handler = leave_copy};
    (void)sigaction(SIGSEGV, &guard, NULL);
    (void)sigaction(SIGBUS, &guard, NULL);
    const bool every = strcmp(arguments[1], "every") == 0;
    if (every || (strcmp(arguments[1], "corners") == 0)) {
        const uint64_t first = strtoull(arguments[2], NULL, 10);
        const uint64_t last = strtoull(arguments[3], NULL, 10);
        try_corners((word)first, (word)last);
        if (!every) {
            return 0;
        }
        try_every(first, last, (real)1.0);
        if (ARITY == 2) {
            try_every(first, last, (real)-1.0);
        }
        return 0;
    }
    try_corners((word)0, (word)-1);
    const bool beside = strcmp(arguments[1], "beside") == 0;
    double domain[4] = {0};
    for (int i = 3; i < count; i++) {
        domain[i - 3] = strtod(arguments[i], NULL);
    }
    const uint64_t blocks = strtoull(arguments[2], NULL, 10);
    for (uint64_t block = 0; block < blocks; block++) {
        for (int i = 0; i < BLOCK; i++) {
            x[i] = beside ? given[next() % GIVEN] : drawn(block % 3U, domain);
            y[i] = drawn((block / 3U) % 3U, domain + 2);
        }
        try_block();
    }
    return 0;
}
