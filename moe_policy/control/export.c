/* From parameters to controls: the network's plan, the regulators along it, and the control step.

Before this file stand the header, the functions rate(x, u, s) -> [dx/dt], [L] and linearisation(x, u, s, h) -> [A B] of
CasADi, the constants and networks of the policy, moe_policy/control/step.c and moe_policy/control/riccati.c. */

#define INTERVALS (KNOTS - 1)

static const boxes limits = {period, control_lower, control_upper};

/* Outputs y of a network at x: matrix products with LeakyReLU between them. */
static void evaluate(const network *n, const double *x, double *y) {
  double work[2][WIDEST];
  for (int l = 0; l < n->layers; ++l) {
    const layer *a = n->layer + l;
    const double *from = l == 0 ? x : work[l % 2];
    double *to = l == n->layers - 1 ? y : work[(l + 1) % 2];
    for (int o = 0; o < a->outputs; ++o) to[o] = a->biases[o];
    for (int i = 0; i < a->inputs; ++i)
      for (int o = 0; o < a->outputs; ++o) to[o] += a->weights[(long)i * a->outputs + o] * from[i];
    if (to != y)
      for (int o = 0; o < a->outputs; ++o)
        if (to[o] < 0) to[o] *= NEGATIVE_SLOPE;
  }
}

static int largest(const double *values) {
  int found = 0;
  for (int i = 1; i < EXPERTS; ++i)
    if (values[i] > values[found]) found = i;
  return found;
}

/* The standardised plan y at standardised parameters x. */
static void combine(const double *x, double *y) {
  double weight[EXPERTS], all = 0, part[PLAN];
  if (EXPERTS == 1) {
    evaluate(experts, x, y);
    return;
  }
  evaluate(&gate, x, weight);
  const int first = largest(weight);
  if (EPSILON == 0) {
    evaluate(experts + first, x, y);
    return;
  }
  const double most = weight[first];
  for (int i = 0; i < EXPERTS; ++i) all += weight[i] = exp((weight[i] - most) / EPSILON);
  for (int j = 0; j < PLAN; ++j) y[j] = 0;
  for (int i = 0; i < EXPERTS; ++i) {
    evaluate(experts + i, x, part);
    for (int j = 0; j < PLAN; ++j) y[j] += weight[i] / all * part[j];
  }
}

/* The component number i of the parameters, written in the turn around the centre of its box. */
static double in_one_turn(double v, int i) {
  if (!(turn[i] > 0) || (v >= turn_first[i] && v < turn_end[i])) return v;
  const double rest = fmod(v - turn_low[i], turn[i]);
  v = turn_low[i] + (rest < 0 ? rest + turn[i] : rest);
  return v >= turn_end[i] ? v - turn[i] : v;
}

void API(plan)(const double *parameters, double *plan) {
  double x[NP], turns[NX] = {0};
  for (int i = 0; i < NP; ++i) {
    const double v = in_one_turn(parameters[i], i);
    if (slot[i] >= 0) turns[slot[i]] = parameters[i] - v;
    x[i] = (v - input_mean[i]) / input_std[i];
  }
  combine(x, plan);
  for (int j = 0; j < PLAN; ++j) plan[j] = plan[j] * output_std[j] + output_mean[j];
  for (int j = 0; j < KNOTS * NX; ++j) plan[j] += turns[j % NX];
}

/* The plan's states and controls in their boxes, its duration within its bounds; whether it is finite. */
static int into_boxes(const double *plan, double *states, double *controls, double *duration, int *clipped) {
  int finite = 1;
  for (int j = 0; j < PLAN; ++j) finite &= isfinite(plan[j]) != 0;
  for (int j = 0; j < KNOTS * NX; ++j) states[j] = clip(plan[j], state_lower[j % NX], state_upper[j % NX]);
  for (int j = 0; j < INTERVALS * NU; ++j)
    controls[j] = clip(plan[KNOTS * NX + j], control_lower[j % NU], control_upper[j % NU]);
  const double seconds = plan[PLAN - 1];
  *clipped = finite && (seconds < SHORTEST - MARGIN || seconds > LONGEST + MARGIN);
  *duration = clip(seconds, SHORTEST, LONGEST);
  return finite;
}

static void rate_at(const double *x, const double *u, const double *context, double *slope) {
  double work[RATE_W + 1];
  const double *arguments[] = {x, u, context};
  double *results[] = {slope, 0};
  rate(arguments, results, 0, work, 0);
}

/* States at the control steps, by cubic Hermite polynomials whose slopes use the interval's own control. */
static void resample(const double *states, const double *controls, double knot_step, const double *context,
                     long long steps, double (*references)[NX]) {
  int known = -1;
  double left_slope[NX], right_slope[NX];
  for (long long k = 0; k < steps; ++k) {
    const double position = clip(DT * k / knot_step, 0.0, INTERVALS);
    const int i = position < INTERVALS - 1 ? (int)position : INTERVALS - 1;
    const double s = position - i, *left = states + i * NX, *right = left + NX;
    if (i != known) {
      rate_at(left, controls + i * NU, context, left_slope);
      rate_at(right, controls + i * NU, context, right_slope);
      known = i;
    }
    for (int j = 0; j < NX; ++j) {
      const double x = (1 + 2 * s) * (1 - s) * (1 - s) * left[j] + s * (1 - s) * (1 - s) * left_slope[j] * knot_step +
                       s * s * (3 - 2 * s) * right[j] + s * s * (s - 1) * right_slope[j] * knot_step;
      references[k][j] = clip(x, state_lower[j], state_upper[j]);
    }
  }
}

/* Time averages of the plan's control over the control steps, with that of the goal after its end. */
static void average(const double *controls, double knot_step, long long steps, double (*means)[NU]) {
  double integral[NU] = {0}, before[NU] = {0};
  int done = 0;
  for (long long k = 1; k <= steps; ++k) {
    const double time = DT * k;
    const int interval = time / knot_step < INTERVALS ? (int)(time / knot_step) : INTERVALS;
    for (; done < interval; ++done)
      for (int j = 0; j < NU; ++j) integral[j] += controls[done * NU + j] * knot_step;
    const double *held = interval < INTERVALS ? controls + interval * NU : goal_control;
    for (int j = 0; j < NU; ++j) {
      const double now = integral[j] + (time - interval * knot_step) * held[j];
      means[k - 1][j] = (now - before[j]) / DT;
      before[j] = now;
    }
  }
}

/* Diagonals of R at the feed-forward controls; see moe_policy/control/weights.py. */
static void weigh(double (*controls)[NU], long long steps, double (*weights)[NU]) {
  for (long long k = 0; k < steps; ++k)
    for (int j = 0; j < NU; ++j) {
      const double u = controls[k][j], width = control_upper[j] - control_lower[j];
      const double authority = fmax(2 * fmin(u - control_lower[j], control_upper[j] - u) / width, AUTHORITY);
      weights[k][j] = weight_control[j] / (authority * authority);
    }
}

/* Terminal regulation from the control step number step on. */
static void hold(API(state) *state, long long step) {
  for (long long k = step; k < LENGTH; ++k) {
    for (int j = 0; j < NX; ++j) state->states[k][j] = goal_state[j];
    for (int j = 0; j < NU; ++j) state->controls[k][j] = goal_control[j];
    for (int j = 0; j < NU * NX; ++j) (&state->gains[k][0][0])[j] = hold_gain[j];
    for (int j = 0; j < NU * NU; ++j) (&state->norms[k][0][0])[j] = hold_norm[j];
  }
}

void API(follow)(API(state) *state, const double *plan, const double *parameters) {
  double states[KNOTS * NX], controls[INTERVALS * NU], weights[LENGTH][NU], context[NC + 1], duration;
  for (int i = 0; i < NC; ++i) context[i] = parameters[context_slot[i]];
  int accepted = into_boxes(plan, states, controls, &duration, &state->clipped);
  long long steps = accepted ? (long long)ceil(duration / DT - COUNT_TOLERANCE) : 0;
  const double knot_step = duration / INTERVALS;
  resample(states, controls, knot_step, context, steps, state->states);
  average(controls, knot_step, steps, state->controls);
  weigh(state->controls, steps, weights);
  along(1, LENGTH, &steps, &state->states[0][0], &state->controls[0][0], context, NC, DT, weight_state, &weights[0][0],
        weight_terminal, &state->gains[0][0][0], &state->norms[0][0][0]);
  for (long long k = 0; k < steps && accepted; ++k)
    for (int j = 0; j < NU * NX; ++j) accepted &= isfinite((&state->gains[k][0][0])[j]) != 0;
  state->rejected = !accepted;
  state->clipped &= accepted;
  state->steps = accepted ? steps : 0;
  state->clock = 0;
  hold(state, state->steps);
}

void API(start)(API(state) *state, const double *parameters) {
  double plan[PLAN];
  API(plan)(parameters, plan);
  API(follow)(state, plan, parameters);
}

void API(act)(API(state) *state, const double *observation, double *control) {
  const tracked t = {&state->states[0][0], &state->controls[0][0], &state->gains[0][0][0], &state->norms[0][0][0]};
  act(1, LENGTH, &state->clock, observation, &limits, &t, control);
  ++state->clock;
}
