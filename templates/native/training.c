/* Optimiser steps of batch after batch, so that no call is paid for each. */

/* A step along the gradient of one batch; 0 if its losses or slopes are not finite or a rank is lost.
   Where slopes of the model can be infinite, the batches in which they are take no step. Numbers of
   rate 0 have no slope, and where all rates are 0 there is no step. */
static int train_batch(struct team *team, struct batch *b, struct variables *v, struct optimizer *o,
                       const double *weights, double *sums, double *counts)
{
    struct totals all;
    real *const gradient = all.slopes;
    double total = 0;
    if (!batch_losses(team, b, v->physical, weights, o->missing, 1, &all)) {
        return 0;
    }
    for (int l = 0; l < LOSSES; l++) {
        const double mean = mean_of(all.sums[l], all.counts[l]);
        total += weights[l] * (IS_ROOT[l] ? sqrt(mean) : mean);
    }
    double squares = 0;
    int moves = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        /* no product: 0 times an infinite slope is NaN */
        gradient[i] = v->rate[i] == 0 ? 0 : gradient[i] * (real)slope(v, i);
        squares += (double)gradient[i] * (double)gradient[i];
        moves |= v->rate[i] != 0;
    }
    const int left_out = INFINITE_SLOPES && !(squares <= LARGEST_SLOPE * LARGEST_SLOPE);
    if (!isfinite(total) || !(left_out || isfinite(squares))) {
        return 0;
    }
    for (int l = 0; l < LOSSES; l++) {
        sums[l] += all.sums[l];
        counts[l] += all.counts[l];
    }
    if (left_out) {
        o->left_out += 1;
        return 1;
    }
    if (!moves) {
        return 1;
    }
    if (o->clip > 0 && sqrt(squares) > o->clip) {
        const double factor = o->clip / (sqrt(squares) + 1e-6);
        for (int i = 0; i < PARAMETERS; i++) {
            gradient[i] *= (real)factor;
        }
    }
    move(v, o, gradient);
    msnn_physical(v);
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
