/* A team of threads that lives as long as one call: nothing is left for a fork or another kernel. */
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>

#define MOST_THREADS 256
#define SPINS 4000                  /* some 10 µs: batches are that short */

struct team;
typedef void job(void *context, int64_t number, int seat);

struct member {
    struct team *team;
    pthread_t thread;
    int seat;
};

struct team {
    int threads;                    /* the caller is one of them, at seat 0 */
    job *work;
    void *context;
    int64_t count;
    atomic_llong next;
    atomic_int rounds;              /* how often there was work */
    atomic_int busy;                /* members that have not finished it */
    int ends;
    struct member members[MOST_THREADS];
};

static void take_part(struct team *team, int seat)
{
    for (;;) {
        const int64_t number = atomic_fetch_add(&team->next, 1);
        if (number >= team->count) {
            return;
        }
        team->work(team->context, number, seat);
    }
}

static void wait_while(atomic_int *value, int equals)
{
    for (int spins = 0; atomic_load(value) == equals; spins++) {
        if (spins >= SPINS) {
            sched_yield();
        }
    }
}

static void *member_life(void *argument)
{
    const struct member *const me = argument;
    struct team *const team = me->team;
    for (int round = 0;; round++) {
        wait_while(&team->rounds, round);
        if (team->ends) {
            return NULL;
        }
        take_part(team, me->seat);
        atomic_fetch_sub(&team->busy, 1);
    }
}

#ifdef _WIN32
/* Windows sends threads no signals. */
typedef int signal_mask;

static void block_signals(signal_mask *before)
{
    *before = 0;
}

static void restore_signals(const signal_mask *before)
{
    (void)before;
}
#else
typedef sigset_t signal_mask;

static void block_signals(signal_mask *before)
{
    sigset_t all_signals;
    sigfillset(&all_signals);
    pthread_sigmask(SIG_SETMASK, &all_signals, before);
}

static void restore_signals(const signal_mask *before)
{
    pthread_sigmask(SIG_SETMASK, before, NULL);
}
#endif

/* Starts the members; signals stay with the caller. Where the system has no more, there are fewer. */
static void open_team(struct team *team, int threads)
{
    signal_mask before;
    team->threads = 1;
    team->ends = 0;
    atomic_init(&team->next, 0);
    atomic_init(&team->rounds, 0);
    atomic_init(&team->busy, 0);
    if (threads <= 1) {
        return;
    }
    block_signals(&before);
    for (int seat = 1; seat < threads && seat < MOST_THREADS; seat++) {
        struct member *const member = &team->members[seat];
        member->team = team;
        member->seat = seat;
        if (pthread_create(&member->thread, NULL, member_life, member) != 0) {
            break;
        }
        team->threads = seat + 1;
    }
    restore_signals(&before);
}

/* Does jobs 0 … count−1, each once, by whoever is free; returns when all are done. */
static void share(struct team *team, int64_t count, job *work, void *context)
{
    team->work = work;
    team->context = context;
    team->count = count;
    atomic_store(&team->next, 0);
    const int helped = team->threads > 1 && count > 1;
    if (helped) {
        atomic_store(&team->busy, team->threads - 1);
        atomic_fetch_add(&team->rounds, 1);
    }
    take_part(team, 0);
    if (helped) {
        for (int left = atomic_load(&team->busy); left > 0; left = atomic_load(&team->busy)) {
            wait_while(&team->busy, left);
        }
    }
}

static void close_team(struct team *team)
{
    team->ends = 1;
    atomic_fetch_add(&team->rounds, 1);
    for (int seat = 1; seat < team->threads; seat++) {
        pthread_join(team->members[seat].thread, NULL);
    }
}
