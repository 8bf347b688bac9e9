/* Interface of the model `reference`. Made by msnn; do not edit. */
#ifndef REFERENCE_H
#define REFERENCE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Speed of a vehicle from pedal and brake: a filtered command, a gain for every range of speed,
 * a drag that saturates. The model on which sizes and instructions are counted. */

typedef float reference_real;

/* The tool and its version, the spec, and a hash of this export: program, weights and options. */
#define REFERENCE_MADE_BY "msnn …"
#define REFERENCE_SPEC_SHA256 \
    "…"
#define REFERENCE_EXPORT_SHA256 \
    "…"

/* The same, as it was compiled; a linker that drops unused data leaves them out. */
extern const char reference_made_by[11];
extern const char reference_spec_sha256[65];
extern const char reference_export_sha256[65];

/* Seconds between two steps: 0.05. */
extern const reference_real reference_sample_time;

/* What step and reset return: 0, or the sum of these bits. */
typedef uint32_t reference_status_t;
#define REFERENCE_OK 0U
/* an input was outside its range and was used as it is */
#define REFERENCE_STATUS_OUT_OF_RANGE 1U
/* an input was NaN */
#define REFERENCE_STATUS_NOT_A_NUMBER 2U
/* a state left its range */
#define REFERENCE_STATUS_STATE_OUT_OF_RANGE 16U
/* neither init nor reset was called, or a state waits for reset */
#define REFERENCE_STATUS_UNINITIALISED 32U

/* What the self-test returns: 0, or the sum of these bits. */
/* a golden step gave other numbers */
#define REFERENCE_SELFTEST_STEP_DIFFERS 256U
/* a mathematical function gave other numbers */
#define REFERENCE_SELFTEST_KERNEL_DIFFERS 512U
/* the compiler fuses multiplications with additions */
#define REFERENCE_SELFTEST_CONTRACTED 1024U
/* the processor flushes subnormal numbers to zero */
#define REFERENCE_SELFTEST_NO_SUBNORMALS 2048U
/* a vector held other numbers than its struct, or the sample time is another */
#define REFERENCE_SELFTEST_HELPER_DIFFERS 4096U
/* the compiler changes the order of sums, or multiplies by reciprocals instead of dividing */
#define REFERENCE_SELFTEST_REORDERED 16384U

/* Inputs of a step. */
typedef struct {
    /* [N/kg] -20 .. 20; commanded acceleration (reference.msnn.yaml:12) */
    reference_real u;
} reference_in_t;

/* Outputs of a step. */
typedef struct {
    /* [m/s] predicts v[t+1] (reference.msnn.yaml:33) */
    reference_real v_next;
} reference_out_t;

/* Trained values. */
typedef struct {
    /* taps, oldest sample first (reference.msnn.yaml:20) */
    reference_real command_weight[25];
    /* gain.by1 7 x 1; one row of weights for each output (reference.msnn.yaml:22) */
    reference_real gain_weight[7];
    /* offset (reference.msnn.yaml:22) */
    reference_real gain_bias[7];
    /* [m/s^2] (reference.msnn.yaml:15) */
    reference_real p0;
    /* [s/m] (reference.msnn.yaml:16) */
    reference_real p1;
    /* (reference.msnn.yaml:17) */
    reference_real p2;
} reference_params_t;

/* What reset takes: samples around the first step t0. */
typedef struct {
    /* [N/kg] samples t0-24 .. t0-1; commanded acceleration (reference.msnn.yaml:12) */
    reference_real u[24];
    /* [m/s] sample t0; speed (reference.msnn.yaml:25) */
    reference_real v;
} reference_init_t;

/* The memory of one instance: plain data. */
typedef struct {
    /* [m/s] -50 .. 50; speed (reference.msnn.yaml:25) */
    reference_real v;
    /* [N/kg] -20 .. 20; last samples, oldest first, and room for the newest; commanded
     * acceleration (reference.msnn.yaml:12) */
    reference_real u_history[24];
    /* 4 after init or reset, and 1 more while buffers wait for their first sample, 2 more while
     * states wait for reset; 0 where nothing was set */
    uint32_t ready;
} reference_state_t;

/* Constants. Most linkers leave them in flash; AVR copies them to RAM, unless gcc compiles every
 * source with -std=gnu99, where a step takes no other parameters, and
 * REFERENCE_IN_FLASH. */
#if defined(REFERENCE_IN_FLASH) && !defined(__cplusplus)
#define REFERENCE_PLACED __flash
#else
#define REFERENCE_PLACED
#endif

/* The trained values. */
extern const REFERENCE_PLACED reference_params_t
    reference_params_default;

/* Sets what is known without data. A buffer of past inputs is filled by the first step with that
 * step's own sample; a state that only a record can give is 0, and every step then returns
 * REFERENCE_STATUS_UNINITIALISED until reset has been called.
 * So does every step of a struct of zeros for which neither was called. */
void reference_init(reference_state_t *s, const REFERENCE_PLACED reference_params_t *p);

/* Sets all states from samples around the first step t0, after the checks that step makes of its
 * inputs. Returns what was out of order: among the samples, or a state that does not begin in its
 * range. Whatever a state has become, even NaN, reset and init leave it. */
reference_status_t reference_reset(
    reference_state_t *s,
    const REFERENCE_PLACED reference_params_t *p,
    const reference_init_t *x0);

/* One step, to be called every sample time. All memory is in *s: instances are independent. */
reference_status_t reference_step(
    reference_state_t *s,
    const REFERENCE_PLACED reference_params_t *p,
    const reference_in_t *u,
    reference_out_t *y);

/* Runs 16 golden steps and checks the arithmetic of this build; 0 if all is well. */
reference_status_t reference_selftest(void);

#ifdef __cplusplus
}
#endif

#endif
