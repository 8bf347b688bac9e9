/* Batches: their losses and slopes, by as many threads as are given. */
/* Groups of one job, whose gradients are added lane by lane before the lanes are. The sum of a batch
   is taken over these blocks in their order, whoever did them: its bits depend on no thread. */
#define BLOCK 4

/* Memory of a call; `memory` has msnn_work_bytes and begins where a vector may. */
struct work {
    void *memory;
    int64_t steps;                  /* of the longest group */
    int64_t groups;                 /* of the largest batch */
    int32_t kept;                   /* whether all rows of a rollout are kept */
    int32_t threads;
};

#define VECTORS(bytes) (((bytes) + sizeof(lanes) - 1) / sizeof(lanes))
#define BLOCKS(groups) ((size_t)(((groups) + BLOCK - 1) / BLOCK))

static size_t lanes_of_thread(const struct work *w)
{
    return PARAMETERS + lanes_of_group((size_t)w->steps, w->kept);
}

int64_t msnn_work_bytes(const struct work *w)
{
    const size_t blocks = BLOCKS(w->groups);
    const size_t results = VECTORS(blocks * LOSSES * sizeof(double)) * 2
                         + VECTORS(blocks * PARAMETERS * sizeof(real));
    const size_t own = (size_t)w->threads * lanes_of_thread(w);
    return (int64_t)((PARAMETERS + results + own) * sizeof(lanes));
}

/* One batch, and where its parts are found. */
struct batch {
    const struct problem *problem;
    const struct work *work;
    const struct group *groups;
    int64_t n;
    const lanes *scale;
    int slopes_wanted;
    int counts_wanted;
    lanes *theta;
    double *sums;                   /* a row a block */
    double *counts;
    real *slopes;
    lanes *own;                     /* of all threads */
};

static struct batch batch_in(const struct problem *p, const struct work *w,
                             const struct group *groups, int64_t n, const lanes *scale)
{
    const size_t numbers = BLOCKS(w->groups) * LOSSES;
    lanes *const theta = w->memory;
    lanes *const sums = theta + PARAMETERS;
    lanes *const counts = sums + VECTORS(numbers * sizeof(double));
    lanes *const slopes = counts + VECTORS(numbers * sizeof(double));
    lanes *const own = slopes + VECTORS(BLOCKS(w->groups) * PARAMETERS * sizeof(real));
    return (struct batch){p, w, groups, n, scale, 0, 0, theta, (double *)sums, (double *)counts,
                          (real *)slopes, own};
}

static void run_block(void *context, int64_t number, int seat)
{
    const struct batch *const b = context;
    lanes *const collected = b->own + (size_t)seat * lanes_of_thread(b->work);
    lanes *const rest = collected + PARAMETERS;
    double *const sums = b->sums + number * LOSSES;
    double *const counts = b->counts_wanted ? b->counts + number * LOSSES : NULL;
    const int64_t begin = number * BLOCK;
    const int64_t end = begin + BLOCK < b->n ? begin + BLOCK : b->n;
    for (int l = 0; l < LOSSES; l++) {
        sums[l] = 0;
        b->counts[number * LOSSES + l] = 0;
    }
    memset(collected, 0, PARAMETERS * sizeof *collected);
    for (int64_t k = begin; k < end; k++) {
        run_group(b->problem, &b->groups[k], b->theta, b->scale, b->work->kept, rest,
                  b->slopes_wanted ? collected : NULL, sums, counts);
    }
    if (b->slopes_wanted) {
        sums_over_lanes(collected, PARAMETERS, b->slopes + number * PARAMETERS);
    }
}

static void add_rows(const double *rows, size_t count, double *sums)
{
    memset(sums, 0, LOSSES * sizeof *sums);
    for (size_t k = 0; k < count; k++) {
        for (int l = 0; l < LOSSES; l++) {
            sums[l] += rows[k * LOSSES + l];
        }
    }
}

/* 0 where nothing is scored; rows with factors can count less than 1 in all. */
static double mean_of(double sum, double count)
{
    return count > 0 ? sum / count : 0.0;
}

/* How many elements each loss counts where no target is missing and every row is scored. */
static void count_all(const struct batch *b, double *counts)
{
    memset(counts, 0, LOSSES * sizeof *counts);
    for (int64_t k = 0; k < b->n; k++) {
        double used = 0;
        for (int i = 0; i < LANES; i++) {
            used += b->groups[k].used[i] ? 1.0 : 0.0;
        }
        for (int l = 0; l < LOSSES; l++) {
            const double steps = fmax((double)(b->groups[k].steps - b->problem->skip), 0.0);
            counts[l] += used * steps * ELEMENTS[l];
        }
    }
}

/* Sums and counts of every loss over a batch, and the gradient in physical values if wanted. */
static void batch_losses(struct team *team, struct batch *b, const real *physical,
                         const double *weights, int missing, real *restrict gradient, double *sums,
                         double *counts)
{
    const size_t blocks = BLOCKS(b->n);
    lanes scale[LOSSES + 1];
    b->scale = scale;
    for (int i = 0; i < PARAMETERS; i++) {
        b->theta[i] = splat(physical[i]);
    }
    b->slopes_wanted = 0;
    b->counts_wanted = 1;
    if (gradient == NULL || missing || HAS_ROOT) {
        share(team, (int64_t)blocks, run_block, b);
        add_rows(b->sums, blocks, sums);
        add_rows(b->counts, blocks, counts);
        if (gradient == NULL) {
            return;
        }
    } else {
        count_all(b, counts);
    }
    for (int l = 0; l < LOSSES; l++) {
        const double root = IS_ROOT[l] ? sqrt(mean_of(sums[l], counts[l])) : 0.5;
        const double slope = counts[l] > 0 && root > 0 ? weights[l] / (2.0 * root * counts[l]) : 0.0;
        scale[l] = splat((real)slope);
    }
    b->slopes_wanted = 1;
    b->counts_wanted = 0;
    share(team, (int64_t)blocks, run_block, b);
    add_rows(b->sums, blocks, sums);
    memset(gradient, 0, PARAMETERS * sizeof *gradient);
    for (size_t k = 0; k < blocks; k++) {
        const real *restrict const slopes = b->slopes + k * PARAMETERS;
        for (int i = 0; i < PARAMETERS; i++) {
            gradient[i] += slopes[i];
        }
    }
}

/* As `batch_losses` for the one batch of all groups. */
void msnn_losses(const struct problem *p, const struct group *groups, int64_t n,
                 const real *physical, const double *weights, int missing, const struct work *work,
                 real *gradient, double *sums, double *counts)
{
    struct team team;
    struct batch b = batch_in(p, work, groups, n, NULL);
    open_team(&team, work->threads);
    batch_losses(&team, &b, physical, weights, missing, gradient, sums, counts);
    close_team(&team);
}
