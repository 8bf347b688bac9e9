/* Solves the same disturbed closed loops by the prototype and by generated controllers, in turns.
 * Each controller has a plant of its own. Every solve of a loop is timed in each of several
 * repetitions; its time is the shortest. A solve counts where an evaluation that knows neither
 * solver finds the optimality conditions to 1e-6. */
#define main prototype_main
#include "prototypes/mpc_staged.c"
#undef main
#undef N

#include "plant_mpc.h"
#include "quick_mpc.h"

#include "draws.h"
#include "judge_mlp.h"

enum { MOST = 4000 };
static const D TOLERANCE = 1e-6;

enum { PROTOTYPE, PROTOTYPE_ONE, PROTOTYPE_FIVE, OURS, OURS_ONE, OURS_FIVE, KINDS };
static const char *NAMES[KINDS] = {"prototype, cap 50", "prototype, 1 iteration",
    "prototype, 5 iterations", "controller, cap 50", "controller, prepare + feedback",
    "controller, 5 iterations"};

typedef struct {
    D x[2], cost, time[MOST], late[MOST];
    int failed, iterations, resets;
    S old;
    plant_mpc_t ours;
    quick_mpc_t quick;
} contender;
static contender all[KINDS];

static void step(contender *c, int kind, int t, const D *dist, int is_long, int first)
{
    D begun, middle, ended, kkt, u = 0, r = 0;
    if (kind <= PROTOTYPE_FIVE) {
        const int caps[3] = {50, 1, 5};
        begun = now();
        const int its = solve(&c->old, c->x, caps[kind], &kkt);
        ended = now();
        middle = begun;
        u = c->old.w[0][2];
        r = judged(c->old.w, c->old.zl, c->old.zu);
        c->iterations += its < 0 ? caps[kind] : its;
        memmove(c->old.w[0], c->old.w[1], sizeof(D) * 3 * HORIZON);
        memmove(c->old.lam[0], c->old.lam[1], sizeof(D) * 2 * HORIZON);
        c->old.w[HORIZON - 1][2] = c->old.w[HORIZON - 2][2];
        c->old.warm = 1;
    } else if (kind == OURS_FIVE) {
        const quick_mpc_in_t in = {{c->x[0], c->x[1]}};
        quick_mpc_out_t out;
        begun = middle = now();
        (void)quick_mpc_solve(&c->quick, &in, &out);
        ended = now();
        u = out.u[0];
        c->iterations += out.iterations;
    } else {
        const plant_mpc_in_t in = {{c->x[0], c->x[1]}};
        plant_mpc_out_t out;
        begun = now();
        if (kind == OURS_ONE) plant_mpc_prepare(&c->ours);
        middle = now();
        const int status = kind == OURS_ONE ? plant_mpc_feedback(&c->ours, &in, &out)
                                            : plant_mpc_solve(&c->ours, &in, &out);
        ended = now();
        u = out.u[0];
        c->iterations += out.iterations;
        r = kind == OURS ? judged_controller(&c->ours) : 0;
        if (kind == OURS && status != 0) r = INFINITY;
    }
    if (first || ended - begun < c->time[t]) c->time[t] = ended - begun;
    if (first || ended - middle < c->late[t]) c->late[t] = ended - middle;
    if (!(r <= TOLERANCE)) c->failed++;
    D y[2], z[3] = {c->x[0], c->x[1], u};
    f0(z, y);
    for (int i = 0; i < 2; i++) {
        c->x[i] = y[i] + dist[2 * t + i];
        c->cost += c->x[i] * c->x[i];
    }
    if (is_long && (fabs(c->x[0]) > 4 || fabs(c->x[1]) > 6)) {
        c->x[0] = 1.2;
        c->x[1] = 0;
        c->resets++;
    }
}

static void compare(const char *name, const D *dist, int steps, int repetitions)
{
    for (int repetition = 0; repetition < repetitions; repetition++) {
        for (int kind = 0; kind < KINDS; kind++) {
            contender *c = &all[kind];
            c->x[0] = 1.2;
            c->x[1] = c->cost = 0;
            c->failed = c->iterations = c->resets = 0;
            memset(&c->old, 0, sizeof c->old);
            plant_mpc_init(&c->ours);
            quick_mpc_init(&c->quick);
        }
        for (int t = 0; t < steps; t++) {
            for (int kind = 0; kind < KINDS; kind++) {
                step(&all[kind], kind, t, dist, steps > 100, repetition == 0);
            }
        }
    }
    for (int kind = 0; kind < KINDS; kind++) {
        contender *c = &all[kind];
        qsort(c->time, (size_t)steps, sizeof(D), cmp);
        qsort(c->late, (size_t)steps, sizeof(D), cmp);
        printf("%s|%s|%g|%g|%g|%g|%g|%d|%.3f|%d\n", name, NAMES[kind], c->time[steps / 2],
            c->time[(int)(steps * .99)], c->time[steps - 1], c->late[steps / 2],
            (D)c->iterations / steps, c->failed, c->cost, c->resets);
    }
}

int main(int count, char **arguments)
{
    const int repetitions = count > 1 ? atoi(arguments[1]) : 5;
    compare("first 30", DIST, 30, repetitions);
    compare("2,000 of w.h", DIST2, 2000, repetitions);
    compare("2,000 fresh", FRESH, 2000, repetitions);
    printf("struct|%zu\n", sizeof(plant_mpc_t));
    return 0;
}
