/* Draws numbers: splitmix64 of G. L. Steele, D. Lea and C. H. Flood (2014), the same in every run. */
#ifndef SPLITMIX64_H
#define SPLITMIX64_H

#include <stdint.h>

static uint64_t state = 0x9E3779B97F4A7C15U;

static uint64_t next(void)
{
    state += 0x9E3779B97F4A7C15U;
    uint64_t z = state;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31);
}

#endif
