/* Interface of the model `spring_damper_rk4`. Made by msnn; do not edit. */
#ifndef SPRING_DAMPER_RK4_H
#define SPRING_DAMPER_RK4_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef float spring_damper_rk4_real;

/* The tool and its version, the spec, and a hash of this export: program, weights and options. */
#define SPRING_DAMPER_RK4_MADE_BY "msnn 0.1.0"
#define SPRING_DAMPER_RK4_SPEC_SHA256 \
    ""
#define SPRING_DAMPER_RK4_EXPORT_SHA256 \
    "…"

/* The same, as it was compiled; a linker that drops unused data leaves them out. */
extern const char spring_damper_rk4_made_by[11];
extern const char spring_damper_rk4_spec_sha256[1];
extern const char spring_damper_rk4_export_sha256[65];

/* Seconds between two steps: 0.05. */
extern const spring_damper_rk4_real spring_damper_rk4_sample_time;

/* What step and reset return: 0, or the sum of these bits. */
typedef uint32_t spring_damper_rk4_status_t;
#define SPRING_DAMPER_RK4_OK 0U
/* an input was outside its range and was used as it is */
#define SPRING_DAMPER_RK4_STATUS_OUT_OF_RANGE 1U
/* an input was NaN */
#define SPRING_DAMPER_RK4_STATUS_NOT_A_NUMBER 2U
/* neither init nor reset was called, or a state waits for reset */
#define SPRING_DAMPER_RK4_STATUS_UNINITIALISED 32U
/* a state without a range is NaN or infinite; init or reset ends that */
#define SPRING_DAMPER_RK4_STATUS_STATE_NOT_FINITE 128U

/* What the self-test returns: 0, or the sum of these bits. */
/* a golden step gave other numbers */
#define SPRING_DAMPER_RK4_SELFTEST_STEP_DIFFERS 256U
/* the compiler fuses multiplications with additions */
#define SPRING_DAMPER_RK4_SELFTEST_CONTRACTED 1024U
/* the processor flushes subnormal numbers to zero */
#define SPRING_DAMPER_RK4_SELFTEST_NO_SUBNORMALS 2048U
/* a vector held other numbers than its struct, or the sample time is another */
#define SPRING_DAMPER_RK4_SELFTEST_HELPER_DIFFERS 4096U
/* the compiler changes the order of sums, or multiplies by reciprocals instead of dividing */
#define SPRING_DAMPER_RK4_SELFTEST_REORDERED 16384U

/* Inputs of a step. */
typedef struct {
    /* [N] -10 .. 10; Force on the mass */
    spring_damper_rk4_real F;
} spring_damper_rk4_in_t;

/* Outputs of a step. */
typedef struct {
    /* [m] */
    spring_damper_rk4_real position;
    /* [N] */
    spring_damper_rk4_real spring_force;
} spring_damper_rk4_out_t;

/* Trained values. */
typedef struct {
    /* [kg] */
    spring_damper_rk4_real mass;
    /* [N*s/m] */
    spring_damper_rk4_real damping;
    /* [N/m] */
    spring_damper_rk4_real stiffness;
    /* [m/s] */
    spring_damper_rk4_real v_start;
} spring_damper_rk4_params_t;

/* What reset takes: samples around the first step t0. */
typedef struct {
    /* [m] sample t0 */
    spring_damper_rk4_real x_meas;
} spring_damper_rk4_init_t;

/* The memory of one instance: plain data. */
typedef struct {
    /* [m] Position */
    spring_damper_rk4_real x;
    /* [m/s] Speed */
    spring_damper_rk4_real v;
    /* 4 after init or reset, and 1 more while buffers wait for their first sample, 2 more while
     * states wait for reset; 0 where nothing was set */
    uint32_t ready;
} spring_damper_rk4_state_t;

/* Constants. Most linkers leave them in flash; AVR copies them to RAM, unless gcc compiles every
 * source with -std=gnu99, where a step takes no other parameters, and
 * SPRING_DAMPER_RK4_IN_FLASH. */
#if defined(SPRING_DAMPER_RK4_IN_FLASH) && !defined(__cplusplus)
#define SPRING_DAMPER_RK4_PLACED __flash
#else
#define SPRING_DAMPER_RK4_PLACED
#endif

/* The trained values. */
extern const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t
    spring_damper_rk4_params_default;

/* Sets what is known without data. A buffer of past inputs is filled by the first step with that
 * step's own sample; a state that only a record can give is 0, and every step then returns
 * SPRING_DAMPER_RK4_STATUS_UNINITIALISED until reset has been called.
 * So does every step of a struct of zeros for which neither was called. */
void spring_damper_rk4_init(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p);

/* Sets all states from samples around the first step t0, after the checks that step makes of its
 * inputs. Returns what was out of order: among the samples, or a state that does not begin in its
 * range. Whatever a state has become, even NaN, reset and init leave it. */
spring_damper_rk4_status_t spring_damper_rk4_reset(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p,
    const spring_damper_rk4_init_t *x0);

/* One step, to be called every sample time. All memory is in *s: instances are independent. */
spring_damper_rk4_status_t spring_damper_rk4_step(
    spring_damper_rk4_state_t *s,
    const SPRING_DAMPER_RK4_PLACED spring_damper_rk4_params_t *p,
    const spring_damper_rk4_in_t *u,
    spring_damper_rk4_out_t *y);

/* Runs 16 golden steps and checks the arithmetic of this build; 0 if all is well. */
spring_damper_rk4_status_t spring_damper_rk4_selftest(void);

#ifdef __cplusplus
}
#endif

#endif
