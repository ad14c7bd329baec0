/* @title@

Written by ocp_envs and moe_policy. No function allocates memory or keeps a state of its own; units are SI.

    parameters   @parameters@
    observation  @observation@
    control      @control@
    plan         states at @KNOTS@ knots (@KNOTS@, @NX@), controls between them (@INTERVALS@, @NU@), duration

A control step takes @DT@ s. Parameters and observations must be finite. */

#ifndef @NAME@_H
#define @NAME@_H
#ifdef __cplusplus
extern "C" {
#endif

enum {
  @NAME@_PARAMETERS = @NP@,
  @NAME@_OBSERVATIONS = @OBSERVATIONS@,
  @NAME@_CONTROLS = @NU@,
  @NAME@_PLAN = @PLAN@,
  @NAME@_LENGTH = @LENGTH@
};

/* A tracked plan: references, feed-forward, gains and norms of the projection at the control steps, those of terminal
regulation from the plan's last one on; the control steps of the plan and those taken so far; whether the duration was
clipped to its bounds, and whether the plan was not finite, so that the policy regulates to the goal at once. */
typedef struct {
  double states[@LENGTH@][@NX@];
  double controls[@LENGTH@][@NU@];
  double gains[@LENGTH@][@NU@][@NX@];
  double norms[@LENGTH@][@NU@][@NU@];
  long long steps, clock;
  int clipped, rejected;
} @name@_state;

/* The plan of the network for the parameters, which may be written in any turn. */
void @name@_plan(const double *parameters, double *plan);
/* Begin to track a plan, whoever made it. */
void @name@_follow(@name@_state *state, const double *plan, const double *parameters);
/* Plan, and begin to track the plan. */
void @name@_start(@name@_state *state, const double *parameters);
/* The control of one control step, within its bounds. */
void @name@_act(@name@_state *state, const double *observation, double *control);

#ifdef __cplusplus
}
#endif
#endif
