/* Loaded before Python: once told to, each thread but the first that has woken others rests, as it
   may where a processor has much else to do. It goes on when Python has called all that it calls at
   its end, and then waits for Python's lock, which the first thread holds. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/syscall.h>
#include <unistd.h>

static atomic_int are_late, python_ends;

void let_threads_be_late(void) { are_late = 1; }

/* For Python to call with its lock held, as the last thing before it gives up its threads. */
void hold_the_lock(void)
{
    python_ends = 1;
    usleep(500000);
}

int pthread_cond_broadcast(pthread_cond_t *condition)
{
    int (*wake)(pthread_cond_t *) =
        (int (*)(pthread_cond_t *))dlsym(RTLD_NEXT, "pthread_cond_broadcast");
    int answer = wake(condition);
    if (are_late && syscall(SYS_gettid) != getpid())
        for (int rests = 0; rests < 100 && !python_ends; rests++)
            usleep(10000);
    return answer;
}
