/* A line search for the strong Wolfe conditions: Nocedal, Wright, Numerical Optimization (2006),
   algorithms 3.5 and 3.6, trial lengths by their formula 3.59. */
#define ENOUGH_FALL 1e-4            /* c1: of what the first slope promises */
#define FLAT_ENOUGH 0.9             /* c2: of the first slope */
#define LEAST_MOVE 1e-14            /* of a raw variable: parameters are scaled to be about 1 */

/* A place along the direction: value and slope of the total there. */
struct place {
    double length;
    double value;                   /* infinite where there is no number, or no slope */
    double slope;
};

struct line {
    struct team *team;
    struct batch *batch;
    struct variables *v;
    const struct optimizer *o;
    const double *weights;
    const double *from;             /* raw variables */
    const double *direction;
    double longest;                 /* of the direction's numbers */
    double *slopes;                 /* at the last place looked at */
    double *lowest;                 /* slopes at the lowest place */
    int looks;                      /* that are left */
};

/* Slopes with those of weight decay and priors, clipped, and by how much these add to the total. */
static double with_known(const struct variables *v, const struct optimizer *o,
                         const real *restrict slopes, double *restrict found)
{
    double added = 0, squares = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        const double raw = v->rate[i] != 0 ? (double)v->raw[i] : 0;
        added += 0.5 * o->decay * raw * raw;
        found[i] = (double)slopes[i] + o->decay * raw;
#if KNOWN
        if (o->known != NULL && v->rate[i] != 0 && o->known->std[i] > 0) {
            const double away = (physical_of(v, i) - o->known->mean[i]) / o->known->std[i];
            added += o->known->spread * away * away;
            found[i] += 2.0 * o->known->spread * away * slope(v, i) / o->known->std[i];
        }
#endif
        squares += found[i] * found[i];
    }
    /* all of them: a minimum is where they add to 0, and parts of them do not */
    const double factor = clip_factor(o, squares);
    for (int i = 0; i < PARAMETERS; i++) {
        found[i] *= factor;
    }
    return added;
}

static double dot(const double *restrict a, const double *restrict b)
{
    double sum = 0;
    for (int i = 0; i < PARAMETERS; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

/* Moves the raw variables so far along the direction; those that are held stay as they are. */
static void go_to(const struct line *line, double length)
{
    struct variables *const v = line->v;
    for (int i = 0; i < PARAMETERS; i++) {
        if (v->rate[i] != 0) {
            v->raw[i] = (real)(line->from[i] + length * line->direction[i]);
        }
    }
    msnn_physical(v);
}

static struct place look(struct line *line, double length)
{
    struct totals all;
    double total;
    line->looks -= 1;
    go_to(line, length);
    if (raw_slopes(line->team, line->batch, line->v, line->o, line->weights, &all, &total) !=
        FINITE) {
        return (struct place){length, INFINITY, 0};
    }
    total += with_known(line->v, line->o, all.slopes, line->slopes);
    return (struct place){length, total, dot(line->slopes, line->direction)};
}

/* Where the cubic through two places is least (3.59); NaN where it is nowhere. */
static double least_of_cubic(struct place a, struct place b)
{
    const double width = b.length - a.length;
    const double bend = a.slope + b.slope - 3.0 * (b.value - a.value) / width;
    const double root = copysign(sqrt(bend * bend - a.slope * b.slope), width);
    return b.length - width * (b.slope + root - bend) / (b.slope - a.slope + 2.0 * root);
}

/* A length between two places. Near an end only once in a row: else the interval hardly shrinks. */
static double between(struct place low, struct place far, int *near_end)
{
    const double first = fmin(low.length, far.length);
    const double last = fmax(low.length, far.length);
    const double margin = 0.1 * (last - first);
    if (!isfinite(far.value)) {     /* too far by no known measure */
        return low.length + 0.1 * (far.length - low.length);
    }
    const double least = least_of_cubic(low, far);
    const double length = isfinite(least) ? fmin(fmax(least, first), last) : 0.5 * (first + last);
    const int is_near = fmin(last - length, length - first) < margin;
    if (is_near && (*near_end || length <= first || length >= last)) {
        *near_end = 0;
        return last - length < length - first ? last - margin : first + margin;
    }
    *near_end = is_near;
    return length;
}

static int falls_enough(struct place start, struct place low, struct place now)
{
    const double promised = start.value + ENOUGH_FALL * now.length * start.slope;
    return now.value <= promised && now.value < low.value;
}

static void take(struct line *line, struct place *low, struct place now)
{
    *low = now;
    memcpy(line->lowest, line->slopes, PARAMETERS * sizeof *line->lowest);
}

/* The lowest place between two of which one is low and the other too far (3.6). */
static struct place zoom(struct line *line, struct place start, struct place low, struct place far)
{
    int near_end = 0;
    while (line->looks > 0 && fabs(far.length - low.length) * line->longest > LEAST_MOVE) {
        const struct place now = look(line, between(low, far, &near_end));
        if (!falls_enough(start, low, now)) {
            far = now;
            continue;
        }
        if (now.slope * (far.length - low.length) >= 0) {
            far = low;
        }
        take(line, &low, now);
        if (fabs(now.slope) <= -FLAT_ENOUGH * start.slope) {
            break;
        }
    }
    return low;
}

/* A lower place from the start along a direction that falls there, first tried at `length`; the
   start itself where there is none (3.5). */
static struct place search_along(struct line *line, struct place start, double length)
{
    struct place low = start;
    while (line->looks > 0) {
        const struct place before = low;
        const struct place now = look(line, length);
        if (!falls_enough(start, low, now)) {
            return zoom(line, start, low, now);
        }
        take(line, &low, now);
        if (fabs(now.slope) <= -FLAT_ENOUGH * start.slope) {
            break;
        }
        if (now.slope >= 0) {
            return zoom(line, start, low, before);
        }
        const double least = least_of_cubic(before, now);
        const double nearest = now.length + 0.01 * (now.length - before.length);
        const double farthest = 10.0 * now.length;
        length = isfinite(least) ? fmin(fmax(least, nearest), farthest) : 0.5 * (nearest + farthest);
    }
    return low;
}
