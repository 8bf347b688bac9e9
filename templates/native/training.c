/* Optimiser steps of batch after batch, so that no call is paid for each. */

static int all_are_held(const struct variables *v)
{
    for (int i = 0; i < PARAMETERS; i++) {
        if (v->rate[i] != 0) {
            return 0;
        }
    }
    return 1;
}

/* A step along the gradient of one batch; 0 if its losses or slopes are not finite or a rank is lost.
   Where slopes of the model can be infinite, the batches in which they are take no step. Where all
   rates are 0 there is none either. */
static int train_batch(struct team *team, struct batch *b, struct variables *v, struct optimizer *o,
                       const double *weights, double *sums, double *counts)
{
    struct totals all;
    double total;
    const int found = raw_slopes(team, b, v, o, weights, &all, &total);
    if (found == NOT_FINITE) {
        return 0;
    }
    for (int l = 0; l < LOSSES; l++) {
        sums[l] += all.sums[l];
        counts[l] += all.counts[l];
    }
    if (found == TOO_STEEP) {
        o->left_out += 1;
        return 1;
    }
    if (all_are_held(v)) {
        return 1;
    }
#if LBFGS
    descend(team, b, v, o, weights, total, all.slopes);
#else
    move(v, o, all.slopes);
    msnn_physical(v);
#endif
    return 1;
}

/* Batches of groups in order, their sums and counts added to those given; returns how many were
   finite, all if none stopped it. */
int64_t msnn_train(const struct problem *p, const struct group *groups, const int64_t *bounds,
                   int64_t batches, struct variables *v, struct optimizer *o, const double *weights,
                   const struct work *work, double *sums, double *counts)
{
    struct team team;
    int64_t done = 0;
    open_team(&team, work->threads);
    while (done < batches) {
        struct batch b = batch_in(p, work, groups + bounds[done], bounds[done + 1] - bounds[done]);
        if (!train_batch(&team, &b, v, o, weights, sums, counts)) {
            break;
        }
        done++;
    }
    close_team(&team);
    return done;
}
