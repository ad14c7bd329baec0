/* The barrier problem of a program of stages: its cost, its constraints, and how far a point is from its solution. */

/* Bounds from here on are none; their terms vanish in the rounding. */
#define FAR 1e20

static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

/* The sum of the logarithms of a - b, of products of 8. */
static double logarithms(const double *a, const double *b, int n) {
  double sum = 0;
  for (int i = 0; i < n; i += 8) {
    double product = 1;
    for (int l = i; l < n && l < i + 8; l++) product *= a[l] - b[l];
    sum += log(product);
  }
  return sum;
}

static double barrier(const state *w, const of_variables z, const of_constraints s) {
  double sum = logarithms(z[0], w->lower[0], (K + 1) * NZ) + logarithms(w->upper[0], z[0], (K + 1) * NZ);
  EACH_STAGE sum += logarithms(s + FIRST(k), w->least + FIRST(k), EQUAL(k) - FIRST(k));
  return w->mu * sum;
}

static double total_cost(const stage_values *at) {
  double sum = 0;
  EACH_STAGE sum += at->cost[k];
  return sum;
}

/* The sum of what z and s violate, and the largest of it; the defects and the residuals of constraints. */
static double violation(const of_variables z, const of_constraints s, const stage_values *at, of_dynamics defect,
                        of_constraints residual, double *largest) {
  double sum = 0, most = 0;
  for (int k = 1; k <= K; k++)
    for (int i = 0; i < NX; i++) {
      double r = at->next[k][i] - z[k][i];
      defect[k][i] = r;
      sum += fabs(r);
      most = larger(fabs(r), most);
    }
  EACH_STAGE for (int c = FIRST(k); c < LAST(k); c++) {
    double r = at->c[c] - (c < EQUAL(k) ? s[c] : 0);
    residual[c] = r;
    sum += fabs(r);
    most = larger(fabs(r), most);
  }
  *largest = most;
  return sum;
}

static void update(state *w) {
  evaluate(w);
  w->violation = violation(w->now.z, w->now.s, &w->at, w->defect, w->residual, &w->largest);
  w->objective = total_cost(&w->at);
}

/* The gradient of the barrier problem without slacks, with the terms of residuals. */
static void right_hand_side(state *w) {
  const point *now = &w->now;
  EACH_VARIABLE {
    double a = now->z[k][i] - w->lower[k][i], b = w->upper[k][i] - now->z[k][i];
    w->sigma[k][i] = now->below[k][i] / a + now->above[k][i] / b;
    w->rhs[k][i] = w->gradient[k][i] - w->mu / a + w->mu / b;
  }
  EACH_STAGE for (int c = FIRST(k); c < LAST(k); c++) {
    double slack = now->s[c] - w->least[c], r = w->residual[c];
    double weight = c < EQUAL(k) ? (w->mu - now->y[c] * r) / slack : now->y[c] - r / SOFT;
    for (int i = 0; i < NZ; i++) w->rhs[k][i] -= weight * w->constraint[c][i];
  }
}

static void step_of_the_others(state *w) {
  const point *now = &w->now;
  point *step = &w->step;
  EACH_VARIABLE {
    double a = now->z[k][i] - w->lower[k][i], b = w->upper[k][i] - now->z[k][i], dz = step->z[k][i];
    step->below[k][i] = (w->mu - now->below[k][i] * dz) / a - now->below[k][i];
    step->above[k][i] = (w->mu + now->above[k][i] * dz) / b - now->above[k][i];
  }
  EACH_STAGE for (int c = FIRST(k); c < LAST(k); c++) {
    double sum = w->residual[c], slack = now->s[c] - w->least[c];
    for (int i = 0; i < NZ; i++) sum += w->constraint[c][i] * step->z[k][i];
    step->s[c] = sum;
    step->y[c] = c < EQUAL(k) ? (w->mu - now->y[c] * sum) / slack - now->y[c] : -sum / SOFT;
  }
}

/* The longest steps, at most 1, that leave the part 1 - `most` of each distance from a bound, and of each multiplier. */
static double longest_step(const state *w, double most) {
  double worst = 0;
  EACH_VARIABLE {
    double a = w->now.z[k][i] - w->lower[k][i], b = w->upper[k][i] - w->now.z[k][i], dz = w->step.z[k][i];
    worst = larger(dz > 0 ? dz / b : -dz / a, worst);
  }
  EACH_INEQUALITY worst = larger(-w->step.s[c] / (w->now.s[c] - w->least[c]), worst);
  return worst > most ? most / worst : 1;
}

static double longest_dual_step(const state *w, double most) {
  double worst = 0;
  EACH_VARIABLE {
    double a = -w->step.below[k][i] / w->now.below[k][i], b = -w->step.above[k][i] / w->now.above[k][i];
    worst = larger(larger(a, b), worst);
  }
  EACH_INEQUALITY worst = larger(-w->step.y[c] / w->now.y[c], worst);
  return worst > most ? most / worst : 1;
}

/* The derivative of the barrier problem's cost along the step. */
static double slope(const state *w) {
  double sum = 0;
  EACH_VARIABLE {
    double a = w->now.z[k][i] - w->lower[k][i], b = w->upper[k][i] - w->now.z[k][i];
    sum += (w->gradient[k][i] - w->mu / a + w->mu / b) * w->step.z[k][i];
  }
  EACH_INEQUALITY sum -= w->mu / (w->now.s[c] - w->least[c]) * w->step.s[c];
  return sum;
}

/* The second derivative of the Lagrangian along the step, which follows from the equations that the step solves. */
static double curvature(const state *w, double along) {
  double sum = -along;
  for (int k = 1; k <= K; k++)
    for (int i = 0; i < NX; i++) sum += (w->now.lambda[k][i] + w->step.lambda[k][i]) * w->defect[k][i];
  EACH_STAGE for (int c = FIRST(k); c < LAST(k); c++) sum -= (w->now.y[c] + w->step.y[c]) * w->residual[c];
  return larger(sum, 0);
}

/* The largest derivative of the Lagrangian; not finite where a derivative is not. */
static double stationarity(const state *w) {
  double most = 0, sum = 0;
  EACH_STAGE for (int i = k ? 0 : w->fixed_step ? NX : H; i < (k < K ? NZ : NX); i++) {
    double r = w->lagrangian[k][i] - w->now.below[k][i] + w->now.above[k][i];
    if (k && i < NX) r -= w->now.lambda[k][i];
    most = larger(fabs(r), most);
    sum += r;
  }
  return isfinite(sum) ? most : sum;
}

/* The largest deviation of a product of multiplier and distance from `mu`. */
static double complementarity(const state *w, double mu) {
  double most = 0;
  EACH_VARIABLE {
    double a = w->now.z[k][i] - w->lower[k][i], b = w->upper[k][i] - w->now.z[k][i];
    most = larger(larger(fabs(a * w->now.below[k][i] - mu), fabs(b * w->now.above[k][i] - mu)), most);
  }
  EACH_INEQUALITY most = larger(fabs(w->now.y[c] * (w->now.s[c] - w->least[c]) - mu), most);
  return most;
}

/* What stationarity and complementarity are divided by: 1 unless multipliers are large. */
static void scales(const state *w, double *dual, double *complementary) {
  double of_bounds = 0, of_dynamics = 0;
  int count = 0;
  EACH_VARIABLE {
    of_bounds += w->now.below[k][i] + w->now.above[k][i];
    count += (w->lower[k][i] > -FAR) + (w->upper[k][i] < FAR);
  }
  EACH_INEQUALITY {
    of_bounds += w->now.y[c];
    count++;
  }
  for (int k = 1; k <= K; k++)
    for (int i = 0; i < NX; i++) of_dynamics += fabs(w->now.lambda[k][i]);
  *dual = larger(100, (of_bounds + of_dynamics) / (K * NX + count)) / 100;
  *complementary = larger(100, of_bounds / SOME(count)) / 100;
}
