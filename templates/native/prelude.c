/* A training kernel: GROUP samples side by side, LANES of them in every `lanes`, which is as wide as
   the processor's vectors. The functions of the model run once for each of the PARTS of a group. Sums
   over a group have the same order on every processor. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stddef.h>
#include <string.h>

#ifdef __FAST_MATH__
#error "a kernel tells NaN from numbers and leaves denormals alone: compile without -ffast-math"
#endif

#if MSNN_DOUBLE
typedef double real;
typedef int64_t truth;
#define ALL_BUT_SIGN INT64_MAX
#define REAL_BYTES 8
#else
typedef float real;
typedef int32_t truth;
#define ALL_BUT_SIGN INT32_MAX
#define REAL_BYTES 4
#endif

/* gcc takes comparisons of vectors that are wider than the processor's apart into single numbers. */
#if defined(__AVX512F__)
#define VECTOR_BYTES 64
#elif defined(__AVX2__)
#define VECTOR_BYTES 32
#else
#define VECTOR_BYTES 16
#endif
#define GROUP (64 / REAL_BYTES)
#define LANES (VECTOR_BYTES / REAL_BYTES)
#define PARTS (GROUP / LANES)

#if LANES == 16
#define all(v) {(v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v), (v)}
#elif LANES == 8
#define all(v) {(v), (v), (v), (v), (v), (v), (v), (v)}
#elif LANES == 4
#define all(v) {(v), (v), (v), (v)}
#else
#define all(v) {(v), (v)}
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
#define never_inline __attribute__((noinline))

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

/* All bits but the sign. */
inline_function lanes lane_abs(lanes x) { return (lanes)((mask)x & (mask)all(ALL_BUT_SIGN)); }

inline_function lanes lane_sign(lanes x)
{
    return choose(x > splat(0), splat(1), choose(x < splat(0), splat(-1), x));
}

/* Whether the processor rounds a · b + c once, in one instruction. */
#if defined(__FMA__) || defined(__aarch64__) || defined(__FP_FAST_FMAF)
#define HAS_FMA
#endif

/* a · b + c rounded once: of a processor that cannot only where its bits shall be those of others,
   since the library takes many times as long. Nothing else is fused: kernels are compiled
   without contraction. */
#if !defined(HAS_FMA) && !defined(REPRODUCIBLE)
inline_function lanes fused(lanes a, lanes b, lanes c) { return a * b + c; }
#elif defined(__FMA__) && !defined(__clang__)
/* gcc makes one instruction of the loop below only sometimes */
#if MSNN_DOUBLE
#define FUSED_128 __builtin_ia32_vfmaddpd
#define FUSED_256 __builtin_ia32_vfmaddpd256
#define FUSED_512(a, b, c) __builtin_ia32_vfmaddpd512_mask(a, b, c, (uint8_t)-1, 4)
#else
#define FUSED_128 __builtin_ia32_vfmaddps
#define FUSED_256 __builtin_ia32_vfmaddps256
#define FUSED_512(a, b, c) __builtin_ia32_vfmaddps512_mask(a, b, c, (uint16_t)-1, 4)
#endif
inline_function lanes fused(lanes a, lanes b, lanes c)
{
#if VECTOR_BYTES == 64
    return FUSED_512(a, b, c);
#elif VECTOR_BYTES == 32
    return FUSED_256(a, b, c);
#else
    return FUSED_128(a, b, c);
#endif
}
#else
inline_function lanes fused(lanes a, lanes b, lanes c)
{
    lanes r;
    for (int i = 0; i < LANES; i++) {
#if MSNN_DOUBLE
        r[i] = __builtin_fma(a[i], b[i], c[i]);
#else
        r[i] = __builtin_fmaf(a[i], b[i], c[i]);
#endif
    }
    return r;
}
#endif

inline_function real square_root(real x)
{
    return sizeof(real) == sizeof(double) ? (real)sqrt((double)x) : (real)sqrtf((float)x);
}

inline_function lanes lane_sqrt(lanes x)
{
    lanes r;
    for (int i = 0; i < LANES; i++) {
        r[i] = square_root(x[i]);
    }
    return r;
}

typedef real bytes_32 __attribute__((vector_size(32)));
typedef real bytes_16 __attribute__((vector_size(16)));

/* Sum over a group, the first of its PARTS vectors at x and the next `apart` behind: by a tree of
   fixed shape in which each half is added to the other. */
inline_function real sum_group(const lanes *x, size_t apart)
{
#if PARTS == 4
    const lanes whole = (x[0] + x[2 * apart]) + (x[apart] + x[3 * apart]);
#elif PARTS == 2
    const lanes whole = x[0] + x[apart];
#else
    const lanes whole = x[0];
    (void)apart;
#endif
#if VECTOR_BYTES == 64
    bytes_32 half[2];
    memcpy(half, &whole, sizeof half);
    const bytes_32 two = half[0] + half[1];
#elif VECTOR_BYTES == 32
    const bytes_32 two = whole;
#endif
#if VECTOR_BYTES == 16
    const bytes_16 one = whole;
#else
    bytes_16 quarter[2];
    memcpy(quarter, &two, sizeof quarter);
    const bytes_16 one = quarter[0] + quarter[1];
#endif
#if MSNN_DOUBLE
    return one[0] + one[1];
#else
    return (one[0] + one[2]) + (one[1] + one[3]);
#endif
}

#if defined(__has_builtin)
#if __has_builtin(__builtin_shufflevector)
#define HAS_SHUFFLE 1
#endif
#endif

/* The sum over a group of each of `count` vectors of PARTS rows, all by the tree of `sum_group`. */
#if defined(HAS_SHUFFLE) && LANES == 16
#define FIRST_HALVES 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23
#define LAST_HALVES 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31
#define FIRST_QUARTERS 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27
#define LAST_QUARTERS 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31
#define FIRST_PAIRS 0, 1, 4, 5, 8, 9, 12, 13, 16, 17, 20, 21, 24, 25, 28, 29
#define LAST_PAIRS 2, 3, 6, 7, 10, 11, 14, 15, 18, 19, 22, 23, 26, 27, 30, 31
#define EVEN 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30
#define ODD 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31
#define folded(a, b, FIRST, LAST) \
    (__builtin_shufflevector(a, b, FIRST) + __builtin_shufflevector(a, b, LAST))

/* Of two vectors, one with half as many partial sums of each. */
inline_function lanes halved(const lanes *x) { return folded(x[0], x[1], FIRST_HALVES, LAST_HALVES); }

inline_function lanes quartered(const lanes *x)
{
    return folded(halved(x), halved(x + 2), FIRST_QUARTERS, LAST_QUARTERS);
}

inline_function lanes paired(const lanes *x)
{
    return folded(quartered(x), quartered(x + 4), FIRST_PAIRS, LAST_PAIRS);
}

static void sums_over_group(const lanes *x, int count, real *sums)
{
    int i = 0;
    for (; i + LANES <= count; i += LANES) {
        const lanes found = folded(paired(x + i), paired(x + i + 8), EVEN, ODD);
        memcpy(sums + i, &found, sizeof found);
    }
    for (; i < count; i++) {
        sums[i] = sum_group(x + i, (size_t)count);
    }
}
#else
static void sums_over_group(const lanes *x, int count, real *sums)
{
    for (int i = 0; i < count; i++) {
        sums[i] = sum_group(x + i, (size_t)count);
    }
}
#endif

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

/* TILE samples of every lane, from rows that lie apart to one vector a sample. */
#define TILE (16 / REAL_BYTES)
typedef real part1 __attribute__((vector_size(16), aligned(sizeof(real))));
#if !defined(HAS_SHUFFLE)
inline_function void transpose(const real *const *from, int64_t at, lanes *out)
{
    for (int i = 0; i < TILE; i++) {
        for (int l = 0; l < LANES; l++) {
            out[i][l] = from[l][at + i];
        }
    }
}
#elif MSNN_DOUBLE
#define TWO_PARTS 0, 1, 2, 3
#define FOUR_PARTS 0, 1, 2, 3, 4, 5, 6, 7
#if LANES == 8
#define EVEN_LANES 0, 8, 2, 10, 4, 12, 6, 14
#define ODD_LANES 1, 9, 3, 11, 5, 13, 7, 15
#elif LANES == 4
#define EVEN_LANES 0, 4, 2, 6
#define ODD_LANES 1, 5, 3, 7
#else
#define EVEN_LANES 0, 2
#define ODD_LANES 1, 3
#endif
#else
#define TWO_PARTS 0, 1, 2, 3, 4, 5, 6, 7
#define FOUR_PARTS 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15
/* Every 16 bytes: the first two numbers of a and b in turn, then the last two. */
#if LANES == 16
#define FIRST_TWO 0, 16, 1, 17, 4, 20, 5, 21, 8, 24, 9, 25, 12, 28, 13, 29
#define LAST_TWO 2, 18, 3, 19, 6, 22, 7, 23, 10, 26, 11, 27, 14, 30, 15, 31
#elif LANES == 8
#define FIRST_TWO 0, 8, 1, 9, 4, 12, 5, 13
#define LAST_TWO 2, 10, 3, 11, 6, 14, 7, 15
#else
#define FIRST_TWO 0, 4, 1, 5
#define LAST_TWO 2, 6, 3, 7
#endif
#endif

#if defined(HAS_SHUFFLE)
/* In each 16 bytes of the result: the same 16 bytes of lanes l, l + TILE, l + 2 TILE, … */
inline_function lanes beside(const real *const *from, int64_t at, int l)
{
    const part1 a = *(const part1 *)(from[l] + at);
#if LANES == TILE
    return a;
#else
    const part1 b = *(const part1 *)(from[l + TILE] + at);
    const bytes_32 low = __builtin_shufflevector(a, b, TWO_PARTS);
#if LANES == 2 * TILE
    return low;
#else
    const part1 c = *(const part1 *)(from[l + 2 * TILE] + at);
    const part1 d = *(const part1 *)(from[l + 3 * TILE] + at);
    const bytes_32 high = __builtin_shufflevector(c, d, TWO_PARTS);
    return __builtin_shufflevector(low, high, FOUR_PARTS);
#endif
#endif
}

inline_function void transpose(const real *const *from, int64_t at, lanes *out)
{
#if MSNN_DOUBLE
    const lanes even = beside(from, at, 0);
    const lanes odd = beside(from, at, 1);
    out[0] = __builtin_shufflevector(even, odd, EVEN_LANES);
    out[1] = __builtin_shufflevector(even, odd, ODD_LANES);
#else
    const lanes a = beside(from, at, 0);
    const lanes b = beside(from, at, 1);
    const lanes c = beside(from, at, 2);
    const lanes d = beside(from, at, 3);
    /* twice in turn: (a, c) and (b, d) first, so that the lanes end in their order */
    const lanes ac_low = __builtin_shufflevector(a, c, FIRST_TWO);
    const lanes ac_high = __builtin_shufflevector(a, c, LAST_TWO);
    const lanes bd_low = __builtin_shufflevector(b, d, FIRST_TWO);
    const lanes bd_high = __builtin_shufflevector(b, d, LAST_TWO);
    out[0] = __builtin_shufflevector(ac_low, bd_low, FIRST_TWO);
    out[1] = __builtin_shufflevector(ac_low, bd_low, LAST_TWO);
    out[2] = __builtin_shufflevector(ac_high, bd_high, FIRST_TWO);
    out[3] = __builtin_shufflevector(ac_high, bd_high, LAST_TWO);
#endif
}
#endif
