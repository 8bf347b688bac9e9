/* Calls every contender in turn and prints medians, ratios and the distance of the results. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "weights.h"

typedef void call(const double *z, const double *lambda, double *r, double *J, double *H);

void own(const double *z, const double *lambda, double *r, double *J, double *H);
void own_libm(const double *z, const double *lambda, double *r, double *J, double *H);
static void own_call(const double *z, const double *lambda, double *r, double *J, double *H)
{
    own(z, lambda, r, J, H);
}
static void own_libm_call(const double *z, const double *lambda, double *r, double *J, double *H)
{
    own_libm(z, lambda, r, J, H);
}

/* What an engineer writes: one sweep forwards with all tangents, one back, no matrix but weights. */
static void matrix_by_hand_call(
    const double *z, const double *lambda, double *r, double *J, double *H)
{
    double h[16], g[16], t[3][16], v[3][16], q[16], p[16], back[16];
    for (int i = 0; i < 16; i++)
        h[i] = tanh(net_bias1[i] + net_weight1_t[i] * z[0] + net_weight1_t[16 + i] * z[1]
            + net_weight1_t[32 + i] * z[2]);
    for (int d = 0; d < 3; d++)
        for (int i = 0; i < 16; i++) t[d][i] = (1 - h[i] * h[i]) * net_weight1_t[16 * d + i];
    memcpy(g, net_bias2, sizeof g);
    memset(v, 0, sizeof v);
    for (int j = 0; j < 16; j++)
        for (int i = 0; i < 16; i++) {
            double weight = net_weight2_t[16 * j + i];
            g[i] += weight * h[j];
            for (int d = 0; d < 3; d++) v[d][i] += weight * t[d][j];
        }
    for (int i = 0; i < 16; i++) g[i] = tanh(g[i]);
    for (int o = 0; o < 2; o++) {
        double sum = net_bias3[o] + z[o];
        for (int i = 0; i < 16; i++) sum += net_weight3[16 * o + i] * g[i];
        r[o] = sum;
        for (int d = 0; d < 3; d++) {
            double slope = o == d;
            for (int i = 0; i < 16; i++)
                slope += net_weight3[16 * o + i] * (1 - g[i] * g[i]) * v[d][i];
            J[o * 3 + d] = slope;
        }
    }
    for (int i = 0; i < 16; i++) {
        double weight = lambda[0] * net_weight3[i] + lambda[1] * net_weight3[16 + i];
        p[i] = weight * (1 - g[i] * g[i]);
        q[i] = -2 * g[i] * p[i];
    }
    memset(back, 0, sizeof back);
    for (int j = 0; j < 16; j++)
        for (int i = 0; i < 16; i++) back[i] += net_weight2[16 * j + i] * p[j];
    for (int a = 0; a < 3; a++)
        for (int b = a; b < 3; b++) {
            double sum = 0;
            for (int i = 0; i < 16; i++) sum += q[i] * v[a][i] * v[b][i];
            for (int i = 0; i < 16; i++)
                sum += back[i] * (-2 * h[i]) * (1 - h[i] * h[i]) * net_weight1_t[16 * a + i]
                    * net_weight1_t[16 * b + i];
            H[a * 3 + b] = H[b * 3 + a] = sum;
        }
}
/* CASADI */

static const struct { const char *name; call *call; } ROWS[] = {
    /* ROWS */
};
enum { COUNT = sizeof ROWS / sizeof ROWS[0], CALLS = 2000, MOST = 10001 };

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec * 1e6 + t.tv_nsec * 1e-3;
}

static int order(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double times[COUNT][MOST];
static double points[CALLS][5];

int main(int count, char **arguments)
{
    int rounds = count > 1 ? atoi(arguments[1]) : 301;
    double first[17], found[17], far[COUNT] = {0}, sink = 0;
    srand(1);
    for (int n = 0; n < CALLS; n++)
        for (int i = 0; i < 5; i++) points[n][i] = 4.0 * rand() / RAND_MAX - 2.0;
    for (int n = 0; n < CALLS; n++)
        for (int c = 0; c < COUNT; c++) {
            double r[2], J[6], H[9];
            memset(J, 0, sizeof J);
            ROWS[c].call(points[n], points[n] + 3, r, J, H);
            memcpy(found, r, sizeof r);
            /* CasADi's matrices are column after column */
            for (int i = 0; i < 6; i++)
                found[2 + i] = strncmp(ROWS[c].name, "CasADi", 6) ? J[i] : J[i % 3 * 2 + i / 3];
            memcpy(found + 8, H, sizeof H);
            if (c == 0) memcpy(first, found, sizeof found);
            for (int i = 0; i < 17; i++) far[c] = fmax(far[c], fabs(found[i] - first[i]));
        }
    for (int round = 0; round < rounds && round < MOST; round++)
        for (int c = 0; c < COUNT; c++) {
            double r[2], J[6], H[9], begin = now();
            for (int n = 0; n < CALLS; n++) {
                ROWS[c].call(points[n], points[n] + 3, r, J, H);
                sink += H[0];
            }
            times[c][round] = (now() - begin) / CALLS;
        }
    double reference = 0;
    for (int c = 0; c < COUNT; c++) {
        qsort(times[c], rounds, sizeof(double), order);
        if (strcmp(ROWS[c].name, "CasADi, written by hand in SX") == 0)
            reference = times[c][rounds / 2];
    }
    printf("%-48s %9s %9s %6s %9s\n", "value + Jacobian + Hessian", "median us", "least us", "ratio",
        "distance");
    for (int c = 0; c < COUNT; c++)
        printf("%-48s %9.3f %9.3f %6.2f %9.1e\n", ROWS[c].name, times[c][rounds / 2], times[c][0],
            times[c][rounds / 2] / reference, far[c]);
    return sink == 0.5;
}
