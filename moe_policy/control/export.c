/* From parameters to controls: the network's plan, the regulators along it, and the control step.

Before this file stand the header, the functions rate(x, u, s) -> [dx/dt], [L] and linearisation(x, u, s, h) -> [A B] of
CasADi, the constants and networks of the policy, and moe_policy/control/step.c, riccati.c and follow.c. */

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

static const regulation regulating = {{period, control_lower, control_upper}, state_lower, state_upper,
                                      weight_state, weight_control, numbers};
static const goals goal = {durations, goal_state, goal_control, hold_gain, hold_norm, weight_terminal};

static tracked arrays_of(API(state) *state) {
  const tracked t = {&state->states[0][0], &state->controls[0][0], &state->gains[0][0][0], &state->norms[0][0][0]};
  return t;
}

void API(follow)(API(state) *state, const double *plan, const double *parameters) {
  double context[NC + 1];
  long long clipped, rejected;
  const tracked t = arrays_of(state);
  for (int i = 0; i < NC; ++i) context[i] = parameters[context_slot[i]];
  follow(1, LENGTH, KNOTS, &regulating, &goal, plan, plan + KNOTS * NX, plan + PLAN - 1, context, &t, &state->steps,
         &clipped, &rejected);
  state->clipped = (int)clipped;
  state->rejected = (int)rejected;
  state->clock = 0;
}

void API(start)(API(state) *state, const double *parameters) {
  double plan[PLAN];
  API(plan)(parameters, plan);
  API(follow)(state, plan, parameters);
}

void API(act)(API(state) *state, const double *observation, double *control) {
  const tracked t = arrays_of(state);
  act(1, LENGTH, &state->clock, observation, &regulating.boxes, &t, control);
  ++state->clock;
}
