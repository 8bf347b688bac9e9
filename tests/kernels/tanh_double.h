/* Scalar functions with the same bits on every IEEE 754 machine. Compile with
   -ffp-contract=off and without -ffast-math. */

#ifndef MODEL_MATH_H
#define MODEL_MATH_H

#ifdef __cplusplus
extern "C" {
#endif

/* Hyperbolic tangent. */
double model_tanh(double x);

#ifdef __cplusplus
}
#endif

#endif /* MODEL_MATH_H */
