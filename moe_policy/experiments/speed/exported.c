/* Seconds of processor time for a plan, for the regulators along it, and for a control step of an exported policy:
means over so many calls of each, at parameters (rows, PARAMETERS) and observations (rows, OBSERVATIONS) in turn. */

#include <time.h>

#include "policy.h"

void seconds(long long calls, long long rows, const double *parameters, const double *observations, double *taken) {
  static policy_state state;
  static double plan[POLICY_PLAN], control[POLICY_CONTROLS];
  volatile double seen = 0;
  for (int what = 0; what < 3; ++what) {
    const long long times = what == 2 ? 100 * calls : calls;
    const clock_t began = clock();
    for (long long i = 0; i < times; ++i) {
      const double *p = parameters + i % rows * POLICY_PARAMETERS;
      if (what == 0) policy_plan(p, plan);
      if (what == 1) policy_follow(&state, plan, p);
      if (what == 2) {
        if (i % POLICY_LENGTH == 0) state.clock = 0;
        policy_act(&state, observations + i % rows * POLICY_OBSERVATIONS, control);
      }
      seen += plan[0] + control[0];
    }
    taken[what] = (double)(clock() - began) / CLOCKS_PER_SEC / (double)times;
  }
}
