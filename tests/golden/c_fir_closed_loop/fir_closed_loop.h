/* Interface of the model `fir_closed_loop`. Made by msnn; do not edit. */
#ifndef FIR_CLOSED_LOOP_H
#define FIR_CLOSED_LOOP_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef float fir_closed_loop_real;

/* The tool and its version, the spec, and a hash of this export: program, weights and options. */
#define FIR_CLOSED_LOOP_MADE_BY "msnn 0.1.0"
#define FIR_CLOSED_LOOP_SPEC_SHA256 \
    ""
#define FIR_CLOSED_LOOP_EXPORT_SHA256 \
    "…"

/* The same, as it was compiled; a linker that drops unused data leaves them out. */
extern const char fir_closed_loop_made_by[11];
extern const char fir_closed_loop_spec_sha256[1];
extern const char fir_closed_loop_export_sha256[65];

/* Seconds between two steps: 0.2. */
extern const fir_closed_loop_real fir_closed_loop_sample_time;

/* What step and reset return: 0, or the sum of these bits. */
typedef uint32_t fir_closed_loop_status_t;
#define FIR_CLOSED_LOOP_OK 0U
/* an input was outside its range and was used as it is */
#define FIR_CLOSED_LOOP_STATUS_OUT_OF_RANGE 1U
/* an input was NaN */
#define FIR_CLOSED_LOOP_STATUS_NOT_A_NUMBER 2U
/* neither init nor reset was called, or a state waits for reset */
#define FIR_CLOSED_LOOP_STATUS_UNINITIALISED 32U
/* a state without a range is NaN or infinite; init or reset ends that */
#define FIR_CLOSED_LOOP_STATUS_STATE_NOT_FINITE 128U

/* What the self-test returns: 0, or the sum of these bits. */
/* a golden step gave other numbers */
#define FIR_CLOSED_LOOP_SELFTEST_STEP_DIFFERS 256U
/* the compiler fuses multiplications with additions */
#define FIR_CLOSED_LOOP_SELFTEST_CONTRACTED 1024U
/* the processor flushes subnormal numbers to zero */
#define FIR_CLOSED_LOOP_SELFTEST_NO_SUBNORMALS 2048U
/* a vector held other numbers than its struct, or the sample time is another */
#define FIR_CLOSED_LOOP_SELFTEST_HELPER_DIFFERS 4096U
/* the compiler changes the order of sums, or multiplies by reciprocals instead of dividing */
#define FIR_CLOSED_LOOP_SELFTEST_REORDERED 16384U

/* Inputs of a step. */
typedef struct {
    /* [N] -10 .. 10; Force */
    fir_closed_loop_real F;
} fir_closed_loop_in_t;

/* Outputs of a step. */
typedef struct {
    /* [m] predicts x[t+1] */
    fir_closed_loop_real x_next;
} fir_closed_loop_out_t;

/* Trained values. */
typedef struct {
    fir_closed_loop_real h_weight[5];
    /* [m/N] */
    fir_closed_loop_real g_weight[1];
} fir_closed_loop_params_t;

/* What reset takes: samples around the first step t0. */
typedef struct {
    /* [m] samples t0-4 .. t0; Position */
    fir_closed_loop_real x[5];
} fir_closed_loop_init_t;

/* The memory of one instance: plain data. */
typedef struct {
    /* [m] -5 .. 5; last samples, oldest first; Position */
    fir_closed_loop_real x_tape[5];
    /* 4 after init or reset, and 1 more while buffers wait for their first sample, 2 more while
     * states wait for reset; 0 where nothing was set */
    uint32_t ready;
} fir_closed_loop_state_t;

/* Constants. Most linkers leave them in flash; AVR copies them to RAM, unless gcc compiles every
 * source with -std=gnu99, where a step takes no other parameters, and
 * FIR_CLOSED_LOOP_IN_FLASH. */
#if defined(FIR_CLOSED_LOOP_IN_FLASH) && !defined(__cplusplus)
#define FIR_CLOSED_LOOP_PLACED __flash
#else
#define FIR_CLOSED_LOOP_PLACED
#endif

/* The trained values. */
extern const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t
    fir_closed_loop_params_default;

/* Sets what is known without data. A buffer of past inputs is filled by the first step with that
 * step's own sample; a state that only a record can give is 0, and every step then returns
 * FIR_CLOSED_LOOP_STATUS_UNINITIALISED until reset has been called.
 * So does every step of a struct of zeros for which neither was called. */
void fir_closed_loop_init(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p);

/* Sets all states from samples around the first step t0, after the checks that step makes of its
 * inputs. Returns what was out of order: among the samples, or a state that does not begin in its
 * range. Whatever a state has become, even NaN, reset and init leave it. */
fir_closed_loop_status_t fir_closed_loop_reset(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p,
    const fir_closed_loop_init_t *x0);

/* One step, to be called every sample time. All memory is in *s: instances are independent. */
fir_closed_loop_status_t fir_closed_loop_step(
    fir_closed_loop_state_t *s,
    const FIR_CLOSED_LOOP_PLACED fir_closed_loop_params_t *p,
    const fir_closed_loop_in_t *u,
    fir_closed_loop_out_t *y);

/* Runs 16 golden steps and checks the arithmetic of this build; 0 if all is well. */
fir_closed_loop_status_t fir_closed_loop_selftest(void);

#ifdef __cplusplus
}
#endif

#endif
