/* A training kernel: LANES samples in every `lanes`, arithmetic of the language's own vectors. */
#include <math.h>
#include <stdint.h>
#include <stddef.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "a kernel tells NaN from numbers and leaves denormals alone: compile without -ffast-math"
#endif

#if MSNN_DOUBLE
typedef double real;
typedef int64_t truth;
#define LANES 8
#define all(v) {(v), (v), (v), (v), (v), (v), (v), (v)}
#else
typedef float real;
typedef int32_t truth;
#define LANES 16
#define all(v) {(v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v)}
#endif

typedef real lanes __attribute__((vector_size(LANES * sizeof(real))));
typedef truth mask __attribute__((vector_size(LANES * sizeof(truth))));
typedef uint32_t words __attribute__((vector_size(LANES * sizeof(uint32_t))));
typedef uint64_t wides __attribute__((vector_size(LANES * sizeof(uint64_t))));
typedef int32_t word_mask __attribute__((vector_size(LANES * sizeof(int32_t))));
typedef int64_t wide_mask __attribute__((vector_size(LANES * sizeof(int64_t))));

#define every_lane ((mask)all(-1))
#define no_lane ((mask)all(0))
#define inline_function static inline __attribute__((always_inline, unused))

inline_function lanes splat(real v) { return (lanes)all(v); }
inline_function words splat_word(uint32_t v) { return (words)all(v); }
inline_function wides splat_wide(uint64_t v) { return (wides)all(v); }

inline_function lanes choose(mask c, lanes a, lanes b)
{
    return (lanes)(((mask)a & c) | ((mask)b & ~c));
}

inline_function words choose_word(mask c, words a, words b)
{
    words m = (words)__builtin_convertvector(c, word_mask);
    return (a & m) | (b & ~m);
}

inline_function wides choose_wide(mask c, wides a, wides b)
{
    wides m = (wides)__builtin_convertvector(c, wide_mask);
    return (a & m) | (b & ~m);
}

inline_function mask choose_mask(mask c, mask a, mask b) { return (a & c) | (b & ~c); }

inline_function int any_lane(mask c)
{
    truth found = 0;
    for (int i = 0; i < LANES; i++) {
        found |= c[i];
    }
    return found != 0;
}

inline_function lanes msnn_minimum(lanes a, lanes b) { return choose((a <= b) | (a != a), a, b); }
inline_function lanes msnn_maximum(lanes a, lanes b) { return choose((a >= b) | (a != a), a, b); }

inline_function lanes msnn_clamp(lanes x, lanes low, lanes high)
{
    return msnn_minimum(msnn_maximum(x, low), high);
}

inline_function lanes lane_abs(lanes x)
{
    return choose(x < splat(0), -x, choose(x == splat(0), splat(0), x));
}

inline_function lanes lane_sign(lanes x)
{
    return choose(x > splat(0), splat(1), choose(x < splat(0), splat(-1), x));
}

inline_function lanes lane_sqrt(lanes x)
{
    lanes r;
    for (int i = 0; i < LANES; i++) {
        r[i] = sizeof(real) == sizeof(double) ? (real)sqrt((double)x[i]) : (real)sqrtf((float)x[i]);
    }
    return r;
}

/* Sum over the lanes by a tree of fixed shape. */
inline_function real sum_lanes(lanes x)
{
    real v[LANES];
    memcpy(v, &x, sizeof v);
    for (int half = LANES / 2; half > 0; half /= 2) {
        for (int i = 0; i < half; i++) {
            v[i] += v[i + half];
        }
    }
    return v[0];
}

/* An entry a lane; lanes that a kernel does not use may hold any index. */
#define LOOK_UP(name, vector, scalar)                                        \
    inline_function vector name(const scalar *table, uint32_t n, words index) \
    {                                                                        \
        vector r;                                                            \
        for (int i = 0; i < LANES; i++) {                                    \
            r[i] = table[index[i] < n ? index[i] : 0U];                      \
        }                                                                    \
        return r;                                                            \
    }
LOOK_UP(look_up, lanes, real)
LOOK_UP(look_up_word, words, uint32_t)
LOOK_UP(look_up_wide, wides, uint64_t)
