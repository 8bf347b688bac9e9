/* Each solve is repeated from the same beginning, and counts with its shortest time: what others
 * have left of the caches is no part of it. */
enum { TIMES = 5 };

/* The seconds that a function takes which CasADi has generated, with room of its own. */
typedef int (*generated)(const D **, D **, long long *, D *, int);

D timed(generated function, const D **from, D **to, long long *integers, D *numbers, int memory)
{
    D shortest = INFINITY;
    for (int i = 0; i < TIMES; i++) {
        const D begun = now();
        (void)function(from, to, integers, numbers, memory);
        shortest = fmin(shortest, now() - begun);
    }
    return 1e-3 * shortest;
}
