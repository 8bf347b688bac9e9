/* Twelve chains of multiply-adds in registers: what one core can do at most, in GFLOP/s of float32. */
#include <stdio.h>
#include <time.h>

/* of the processor's own width: gcc takes wider ones apart */
#if defined(__AVX512F__)
#define BYTES 64
#elif defined(__AVX2__)
#define BYTES 32
#else
#define BYTES 16
#endif
typedef float lanes __attribute__((vector_size(BYTES)));

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(void)
{
    enum { TURNS = 20000000 };
    double best = 0;
    float used = 0;
    for (int round = 0; round < 5; round++) {
        const lanes m = (lanes){0} + 0.999f;
        const lanes c = (lanes){0} + 0.001f;
        /* each begins elsewhere: a compiler makes one chain of equal ones */
        lanes a = m + 1, b = m + 2, d = m + 3, e = m + 4, f = m + 5, g = m + 6;
        lanes h = m + 7, i = m + 8, j = m + 9, k = m + 10, l = m + 11, n = m + 12;
        const double begin = seconds();
        for (int turn = 0; turn < TURNS; turn++) {
            a = a * m + c; b = b * m + c; d = d * m + c; e = e * m + c; f = f * m + c; g = g * m + c;
            h = h * m + c; i = i * m + c; j = j * m + c; k = k * m + c; l = l * m + c; n = n * m + c;
        }
        const double rate = TURNS * 12.0 * (BYTES / 4) * 2.0 / (seconds() - begin) / 1e9;
        best = rate > best ? rate : best;
        const lanes sum = a + b + d + e + f + g + h + i + j + k + l + n;
        used += sum[0];
    }
    printf("%.1f %g\n", best, (double)used);
    return 0;
}
