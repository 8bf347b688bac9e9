/* Batches: their losses and slopes, by as many threads as are given. */
/* Groups of one job, whose gradients are added sample by sample before the samples of a group are. The sum of a batch
   is taken over these blocks in their order, whoever did them: its bits depend on no thread. */
#define BLOCK 4

/* Takes `size` bytes of sums from the rank before, or with `whole` hands them on to the next and
   takes those of the last; 0 where a rank is lost. */
typedef int32_t hand_on(int32_t whole, void *sums, int64_t size);

/* Memory of a call; `memory` has msnn_work_bytes and begins where a vector may. */
struct work {
    void *memory;
    int64_t steps;                  /* of the longest group */
    int64_t groups;                 /* of the largest batch */
    int32_t kept;                   /* whether all rows of a rollout are kept */
    int32_t threads;
    int32_t rank;                   /* of `ranks` processes that share every batch */
    int32_t ranks;
    hand_on *hand_on;               /* NULL in one process */
};

/* What a batch is summed up to. Each rank adds its blocks to the sums of those before, so that they
   are added in the order that one process has, to the same bits. */
struct totals {
    double sums[LOSSES + 1];
    double counts[LOSSES + 1];
    real slopes[PARAMETERS + 1];    /* in physical values */
};

#define VECTORS(bytes) (((bytes) + sizeof(lanes) - 1) / sizeof(lanes))
#define BLOCKS(groups) ((size_t)(((groups) + BLOCK - 1) / BLOCK))

static size_t lanes_of_thread(const struct work *w)
{
    return PARTS * PARAMETERS + lanes_of_group((size_t)w->steps, w->kept);
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
    int64_t begin;                  /* the blocks of this rank */
    int64_t end;
    const lanes *scale;
    int slopes_wanted;
    int counts_wanted;
    lanes *theta;
    double *sums;                   /* a row a block */
    double *counts;
    real *slopes;
    lanes *own;                     /* of all threads */
};

/* The first block of a rank: ranks have as many steps each as whole blocks allow. */
static int64_t first_block(const struct group *groups, int64_t n, int64_t rank, int64_t ranks)
{
    int64_t steps = 0;
    int64_t before = 0;
    for (int64_t k = 0; k < n; k++) {
        steps += groups[k].steps;
    }
    for (int64_t k = 0; k < n; k++) {
        if (k % BLOCK == 0 && before * ranks >= rank * steps) {
            return k / BLOCK;
        }
        before += groups[k].steps;
    }
    return (int64_t)BLOCKS(n);
}

static struct batch batch_in(const struct problem *p, const struct work *w,
                             const struct group *groups, int64_t n)
{
    const size_t numbers = BLOCKS(w->groups) * LOSSES;
    lanes *const theta = w->memory;
    lanes *const sums = theta + PARAMETERS;
    lanes *const counts = sums + VECTORS(numbers * sizeof(double));
    lanes *const slopes = counts + VECTORS(numbers * sizeof(double));
    lanes *const own = slopes + VECTORS(BLOCKS(w->groups) * PARAMETERS * sizeof(real));
    const int alone = w->hand_on == NULL;
    const int64_t begin = alone ? 0 : first_block(groups, n, w->rank, w->ranks);
    const int64_t end = alone ? (int64_t)BLOCKS(n) : first_block(groups, n, w->rank + 1, w->ranks);
    return (struct batch){p, w, groups, n, begin, end, NULL, 0, 0, theta, (double *)sums,
                          (double *)counts, (real *)slopes, own};
}

static void run_block(void *context, int64_t job, int seat)
{
    const struct batch *const b = context;
    const int64_t number = b->begin + job;
    lanes *const collected = b->own + (size_t)seat * lanes_of_thread(b->work);
    lanes *const rest = collected + PARTS * PARAMETERS;
    double *const sums = b->sums + number * LOSSES;
    double *const counts = b->counts_wanted ? b->counts + number * LOSSES : NULL;
    const int64_t begin = number * BLOCK;
    const int64_t end = begin + BLOCK < b->n ? begin + BLOCK : b->n;
    for (int l = 0; l < LOSSES; l++) {
        sums[l] = 0;
        b->counts[number * LOSSES + l] = 0;
    }
    memset(collected, 0, PARTS * PARAMETERS * sizeof *collected);
    for (int64_t k = begin; k < end; k++) {
        run_group(b->problem, &b->groups[k], b->theta, b->scale, b->work->kept, rest,
                  b->slopes_wanted ? collected : NULL, sums, counts);
    }
    if (b->slopes_wanted) {
        sums_over_group(collected, PARAMETERS, b->slopes + number * PARAMETERS);
    }
}

static void add_rows(const struct batch *b, const double *rows, double *sums)
{
    for (int64_t k = b->begin; k < b->end; k++) {
        for (int l = 0; l < LOSSES; l++) {
            sums[l] += rows[k * LOSSES + l];
        }
    }
}

/* Does the blocks and sums up what of them is wanted; 0 where a rank is lost. */
static int run_blocks(struct team *team, struct batch *b, struct totals *all)
{
    hand_on *const hand = b->work->hand_on;
    const size_t size = b->slopes_wanted ? sizeof *all : offsetof(struct totals, slopes);
    share(team, b->end - b->begin, run_block, b);
    memset(all->sums, 0, sizeof all->sums);
    if (b->counts_wanted) {
        memset(all->counts, 0, sizeof all->counts);
    }
    if (b->slopes_wanted) {
        memset(all->slopes, 0, sizeof all->slopes);
    }
    if (hand != NULL && !hand(0, all, (int64_t)size)) {
        return 0;
    }
    add_rows(b, b->sums, all->sums);
    if (b->counts_wanted) {
        add_rows(b, b->counts, all->counts);
    }
    for (int64_t k = b->begin; b->slopes_wanted && k < b->end; k++) {
        const real *restrict const slopes = b->slopes + k * PARAMETERS;
        for (int i = 0; i < PARAMETERS; i++) {
            all->slopes[i] += slopes[i];
        }
    }
    return hand == NULL || hand(1, all, (int64_t)size);
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
        for (int i = 0; i < GROUP; i++) {
            used += b->groups[k].used[i] ? 1.0 : 0.0;
        }
        for (int l = 0; l < LOSSES; l++) {
            const double steps = fmax((double)(b->groups[k].steps - b->problem->skip), 0.0);
            counts[l] += used * steps * ELEMENTS[l];
        }
    }
}

/* Sums and counts of every loss over a batch, and its slopes if wanted; 0 where a rank is lost. */
static int batch_losses(struct team *team, struct batch *b, const real *physical,
                        const double *weights, int missing, int slopes_wanted, struct totals *all)
{
    lanes scale[LOSSES + 1];
    b->scale = scale;
    for (int i = 0; i < PARAMETERS; i++) {
        b->theta[i] = splat(physical[i]);
    }
    b->slopes_wanted = 0;
    b->counts_wanted = 1;
    if (!slopes_wanted || missing || HAS_ROOT) {
        if (!run_blocks(team, b, all)) {
            return 0;
        }
        if (!slopes_wanted) {
            return 1;
        }
    } else {
        count_all(b, all->counts);
    }
    for (int l = 0; l < LOSSES; l++) {
        const double root = IS_ROOT[l] ? sqrt(mean_of(all->sums[l], all->counts[l])) : 0.5;
        const double slope =
            all->counts[l] > 0 && root > 0 ? weights[l] / (2.0 * root * all->counts[l]) : 0.0;
        scale[l] = splat((real)slope);
    }
    b->slopes_wanted = 1;
    b->counts_wanted = 0;
    return run_blocks(team, b, all);
}

/* As `batch_losses` for the one batch of all groups. */
void msnn_losses(const struct problem *p, const struct group *groups, int64_t n,
                 const real *physical, const double *weights, int missing, const struct work *work,
                 real *gradient, double *sums, double *counts)
{
    struct team team;
    struct totals all;
    struct batch b = batch_in(p, work, groups, n);
    open_team(&team, work->threads);
    if (batch_losses(&team, &b, physical, weights, missing, gradient != NULL, &all)) {
        memcpy(sums, all.sums, LOSSES * sizeof *sums);
        memcpy(counts, all.counts, LOSSES * sizeof *counts);
        if (gradient != NULL) {
            memcpy(gradient, all.slopes, PARAMETERS * sizeof *gradient);
        }
    }
    close_team(&team);
}
