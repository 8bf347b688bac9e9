/* Interface of the model `joint_arm`. Made by msnn; do not edit. */
#ifndef JOINT_ARM_H
#define JOINT_ARM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef float joint_arm_real;

/* The tool and its version, the spec, and a hash of this export: program, weights and options. */
#define JOINT_ARM_MADE_BY "msnn 0.1.0"
#define JOINT_ARM_SPEC_SHA256 \
    ""
#define JOINT_ARM_EXPORT_SHA256 \
    "…"

/* The same, as it was compiled; a linker that drops unused data leaves them out. */
extern const char joint_arm_made_by[11];
extern const char joint_arm_spec_sha256[1];
extern const char joint_arm_export_sha256[65];

/* Seconds between two steps: 0.001. */
extern const joint_arm_real joint_arm_sample_time;

/* What step and reset return: 0, or the sum of these bits. */
typedef uint32_t joint_arm_status_t;
#define JOINT_ARM_OK 0U
/* an input was outside its range and was used as it is */
#define JOINT_ARM_STATUS_OUT_OF_RANGE 1U
/* an input was NaN */
#define JOINT_ARM_STATUS_NOT_A_NUMBER 2U
/* neither init nor reset was called, or a state waits for reset */
#define JOINT_ARM_STATUS_UNINITIALISED 32U
/* a state without a range is NaN or infinite; init or reset ends that */
#define JOINT_ARM_STATUS_STATE_NOT_FINITE 128U

/* What the self-test returns: 0, or the sum of these bits. */
/* a golden step gave other numbers */
#define JOINT_ARM_SELFTEST_STEP_DIFFERS 256U
/* a mathematical function gave other numbers */
#define JOINT_ARM_SELFTEST_KERNEL_DIFFERS 512U
/* the compiler fuses multiplications with additions */
#define JOINT_ARM_SELFTEST_CONTRACTED 1024U
/* the processor flushes subnormal numbers to zero */
#define JOINT_ARM_SELFTEST_NO_SUBNORMALS 2048U
/* a vector held other numbers than its struct, or the sample time is another */
#define JOINT_ARM_SELFTEST_HELPER_DIFFERS 4096U
/* the compiler changes the order of sums, or multiplies by reciprocals instead of dividing */
#define JOINT_ARM_SELFTEST_REORDERED 16384U

/* Inputs of a step. */
typedef struct {
    /* [N*m] -5 .. 5 */
    joint_arm_real tau[3];
} joint_arm_in_t;

/* Outputs of a step. */
typedef struct {
    /* [rad] predicts q[t+1] */
    joint_arm_real q_next[3];
    /* [rad] */
    joint_arm_real q_shown[3];
} joint_arm_out_t;

/* Trained values. */
typedef struct {
    /* joint 3 x t 4; */
    joint_arm_real own_weight[12];
    /* [rad/N/m] joint_2 3 x joint 3; */
    joint_arm_real coupling[9];
    /* basis 2 x joint 3; */
    joint_arm_real shape[6];
} joint_arm_params_t;

/* What reset takes: samples around the first step t0. */
typedef struct {
    /* [rad] joint 3 x t 4; samples t0-3 .. t0; Joint angles */
    joint_arm_real q[12];
} joint_arm_init_t;

/* The memory of one instance: plain data. */
typedef struct {
    /* [rad] joint 3 x t 4; -3 .. 3; last samples, oldest first; Joint angles */
    joint_arm_real q_tape[12];
    /* 4 after init or reset, and 1 more while buffers wait for their first sample, 2 more while
     * states wait for reset; 0 where nothing was set */
    uint32_t ready;
} joint_arm_state_t;

/* Constants. Most linkers leave them in flash; AVR copies them to RAM, unless gcc compiles every
 * source with -std=gnu99, where a step takes no other parameters, and
 * JOINT_ARM_IN_FLASH. */
#if defined(JOINT_ARM_IN_FLASH) && !defined(__cplusplus)
#define JOINT_ARM_PLACED __flash
#else
#define JOINT_ARM_PLACED
#endif

/* The trained values. */
extern const JOINT_ARM_PLACED joint_arm_params_t
    joint_arm_params_default;

/* Sets what is known without data. A buffer of past inputs is filled by the first step with that
 * step's own sample; a state that only a record can give is 0, and every step then returns
 * JOINT_ARM_STATUS_UNINITIALISED until reset has been called.
 * So does every step of a struct of zeros for which neither was called. */
void joint_arm_init(joint_arm_state_t *s, const JOINT_ARM_PLACED joint_arm_params_t *p);

/* Sets all states from samples around the first step t0, after the checks that step makes of its
 * inputs. Returns what was out of order: among the samples, or a state that does not begin in its
 * range. Whatever a state has become, even NaN, reset and init leave it. */
joint_arm_status_t joint_arm_reset(
    joint_arm_state_t *s,
    const JOINT_ARM_PLACED joint_arm_params_t *p,
    const joint_arm_init_t *x0);

/* One step, to be called every sample time. All memory is in *s: instances are independent. */
joint_arm_status_t joint_arm_step(
    joint_arm_state_t *s,
    const JOINT_ARM_PLACED joint_arm_params_t *p,
    const joint_arm_in_t *u,
    joint_arm_out_t *y);

/* Runs 16 golden steps and checks the arithmetic of this build; 0 if all is well. */
joint_arm_status_t joint_arm_selftest(void);

#ifdef __cplusplus
}
#endif

#endif
