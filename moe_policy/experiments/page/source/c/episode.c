/* An episode of the exported policy in the simulator, for JavaScript, which reads and writes the arrays by name.

The build defines NX, NU, NC, CLEARANCES and STEPS, the control steps of the longest episode. */

#include "policy.h"

typedef long long integer;
int control_step(const double **arguments, double **results, integer *iw, double *w, int memory);
int goal_error(const double **arguments, double **results, integer *iw, double *w, int memory);
int clearances(const double **arguments, double **results, integer *iw, double *w, int memory);

/* Written before an episode: the parameters, the plan in the flat layout, the first of the states, the context. */
double parameters[POLICY_PARAMETERS], plan[POLICY_PLAN], states[STEPS + 1][NX], context[NC + 1];
/* Read after it: of each control step, and of the states at its ends. */
double controls[STEPS][NU], costs[STEPS], left_box[STEPS], errors[STEPS + 1], least_clearance[STEPS + 1];

static policy_state tracking;
static double work[WORK];

/* The error to the goal and the smallest clearance of the state number k. */
static void measure(int k) {
  double values[CLEARANCES + 1];
  const double *arguments[] = {states[k], context};
  double *error[] = {errors + k}, *clear[] = {values};
  goal_error(arguments, error, 0, work, 0);
  clearances(arguments, clear, 0, work, 0);
  least_clearance[k] = 1e300;
  for (int i = 0; i < CLEARANCES; ++i)
    if (values[i] < least_clearance[k]) least_clearance[k] = values[i];
}

/* Track the plan and regulate to the goal for so many control steps after it; the control steps of the plan. */
int episode(int after) {
  policy_follow(&tracking, plan, parameters);
  const int steps = (int)tracking.steps;
  measure(0);
  for (int k = 0; k < steps + after && k < STEPS; ++k) {
    double observation[NX + NC], summary[4];
    for (int i = 0; i < NX; ++i) observation[i] = states[k][i];
    for (int i = 0; i < NC; ++i) observation[NX + i] = context[i];
    policy_act(&tracking, observation, controls[k]);
    const double *arguments[] = {states[k], controls[k], context};
    double *results[] = {states[k + 1], summary};
    control_step(arguments, results, 0, work, 0);
    costs[k] = summary[0];
    left_box[k] = summary[3];
    measure(k + 1);
  }
  return steps;
}
