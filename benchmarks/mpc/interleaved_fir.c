/* Solves the same closed loops of a FIR plant by the prototype and by generated controllers, in
 * turns. Each has a plant of its own. Every solve is timed in each of several repetitions; its time
 * is the shortest. A solve counts where an evaluation that knows neither solver finds the
 * optimality conditions to 1e-6. */
#define main prototype_main
#include "prototypes/mpc_condensed.c"
#undef main
#undef N
#undef L

#include "condensed_mpc.h"
#include "staged_mpc.h"

#include "judge_fir.h"
#include "steps.h"

enum { MOST = 4000 };
static const D TOLERANCE = 1e-6;

enum { PROTOTYPE, CONDENSED, CONDENSED_ONE, STAGED, KINDS };
static const char *NAMES[KINDS] = {
    "prototype", "condensed", "condensed, prepare + feedback", "staged"};

typedef struct {
    D y, past[WINDOW - 1], cost, time[MOST], late[MOST];
    int failed, iterations, most;
    St old;
    condensed_mpc_t own;
    staged_mpc_t staged;
} contender;
static contender all[KINDS];

static D reference(int set, int t)
{
    if (set == 0) return .5 * sin(t * .15);
    return set == 1 ? 3. * ((t / 25) % 2 ? 1 : -1) : STEPS[t];
}

static void step(contender *c, int kind, int set, int t, int first)
{
    D r[HORIZON + 1], u[HORIZON], m[4][HORIZON], kkt, begun, middle, ended;
    const D v = set == 2 ? SPEEDS[t] : 15 + 5 * sin(t * .1);
    int its = 1, ok = 1;
    for (int k = 0; k <= HORIZON; k++) r[k] = reference(set, t + k);
    if (kind == PROTOTYPE) {
        begun = middle = now();
        blend(v);
        its = solve(&c->old, c->y, c->past, r, 50, &kkt);
        ended = now();
        ok = its >= 0;
        for (int k = 0; k < HORIZON; k++) {
            u[k] = c->old.u[k];
            m[0][k] = c->old.zl[k], m[1][k] = c->old.zu[k], m[2][k] = c->old.yl[k],
            m[3][k] = c->old.yu[k];
        }
        memmove(c->old.u, c->old.u + 1, sizeof(D) * (HORIZON - 1));
        c->old.warm = 1;
    } else if (kind == STAGED) {
        staged_mpc_in_t in;
        staged_mpc_out_t out;
        in.x[0] = c->y;
        in.v = v;
        memcpy(in.x + 1, c->past, sizeof c->past);
        memcpy(in.r, r, sizeof r);
        begun = middle = now();
        ok = staged_mpc_solve(&c->staged, &in, &out) == 0;
        ended = now();
        its = out.iterations;
        for (int k = 0; k < HORIZON; k++) {
            u[k] = c->staged.z[k][30];
            for (int i = 0; i < 4; i++) m[i][k] = c->staged.multiplier[k + (i > 1)][i];
        }
    } else {
        condensed_mpc_in_t in;
        condensed_mpc_out_t out;
        in.x[0] = c->y;
        in.v = v;
        memcpy(in.x + 1, c->past, sizeof c->past);
        memcpy(in.r, r, sizeof r);
        begun = now();
        if (kind == CONDENSED_ONE) condensed_mpc_prepare(&c->own);
        middle = now();
        ok = (kind == CONDENSED_ONE ? condensed_mpc_feedback(&c->own, &in, &out)
                                    : condensed_mpc_solve(&c->own, &in, &out)) == 0;
        ended = now();
        its = out.iterations;
        for (int k = 0; k < HORIZON; k++) {
            u[k] = c->own.z[PLAN_U + k];
            for (int i = 0; i < 4; i++) m[i][k] = c->own.multiplier[k + (i > 1)][i];
        }
        if (kind == CONDENSED_ONE) u[0] = out.u[0];
    }
    blend(v);
    if (kind != CONDENSED_ONE && !(ok && judged(c->y, c->past, r, u, m) <= TOLERANCE)) c->failed++;
    c->iterations += its;
    if (its > c->most) c->most = its;
    if (first || ended - begun < c->time[t]) c->time[t] = ended - begun;
    if (first || ended - middle < c->late[t]) c->late[t] = ended - middle;
    D y[HORIZON + 1];
    roll(c->y, c->past, u, y);
    c->y = y[1];
    memmove(c->past, c->past + 1, sizeof(D) * (WINDOW - 2));
    c->past[WINDOW - 2] = u[0];
    c->cost += (c->y - r[1]) * (c->y - r[1]);
}

static void compare(const char *name, int set, int steps, int repetitions)
{
    for (int repetition = 0; repetition < repetitions; repetition++) {
        for (int kind = 0; kind < KINDS; kind++) {
            contender *c = &all[kind];
            c->y = c->cost = 0;
            c->failed = c->iterations = c->most = 0;
            memset(c->past, 0, sizeof c->past);
            memset(&c->old, 0, sizeof c->old);
            condensed_mpc_init(&c->own);
            staged_mpc_init(&c->staged);
        }
        for (int t = 0; t < steps; t++) {
            for (int kind = 0; kind < KINDS; kind++) step(&all[kind], kind, set, t, !repetition);
        }
    }
    for (int kind = 0; kind < KINDS; kind++) {
        contender *c = &all[kind];
        qsort(c->time, (size_t)steps, sizeof(D), cmp);
        qsort(c->late, (size_t)steps, sizeof(D), cmp);
        printf("%s|%s|%g|%g|%g|%g|%g|%d|%d|%.4f\n", name, NAMES[kind], c->time[steps / 2],
            c->time[(int)(steps * .99)], c->time[steps - 1], c->late[steps / 2],
            (D)c->iterations / steps, c->most, c->failed, c->cost);
    }
}

int main(int count, char **arguments)
{
    const int repetitions = count > 1 ? atoi(arguments[1]) : 5;
    compare("sine", 0, 2000, repetitions);
    compare("steps of 3", 1, 2000, repetitions);
    compare("drawn steps", 2, 2000, repetitions);
    printf("struct|%zu|%zu\n", sizeof(condensed_mpc_t), sizeof(staged_mpc_t));
    return 0;
}
