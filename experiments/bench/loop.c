/* The physical limit: the closed loop of the motor, its filter and its bound, by hand.

   The same arithmetic as `closed_loop.loop_error`: knots -> reference -> ARC -> one Runge-Kutta step
   per tick -> means over the tick -> H_f -> log of the smoothed worst-case error (29); and its
   adjoint, for which the way there keeps all that the way back needs. NODES and WEIGHTS are the
   tableau of jaxid.loop.simulate and STAGES its length. With LANES above one a Real is a vector of that
   many loops side by side, each with its own jerk and θ; the adjoint is for one loop. */

#include <math.h>

#define M 4       /* parameters: M, B, Fc, dbar */
#define W (M + 1) /* columns of a row: φ₁ … φ₄, δ */

#if LANES == 1
typedef double Real;
#define EACH(result, expression) do { enum { l = 0 }; result = expression; } while (0)
#define AT(x) (x)
#else
typedef double Real __attribute__((vector_size(8 * LANES), aligned(8)));
#define EACH(result, expression) \
    do { _Pragma("omp simd") for (int l = 0; l < LANES; l++) (result)[l] = expression; } while (0)
#define AT(x) ((x)[l])
#endif

typedef struct {
    double beta, slow, fast, threshold, blend, lower[M], upper[M];
    double k1, k2, epsilon, gamma[M], period, keep, knot_period, smoothing;
    int target, intervals, per_interval, repeats;
} Case;

static const double node[STAGES] = {NODES}, weight[STAGES] = {WEIGHTS};

typedef struct { Real y, v, hat[M], passed[W]; } State; /* of axis, controller and filters */
typedef struct { Real y, v, a; } Desired;
typedef struct { Real sign, delta, angle, share; } Friction;
typedef struct { Real v, p, x, mismatch, hat[M], speed[STAGES]; Friction at[STAGES]; } Kept;
typedef struct { Real P[M][M], mixture[M], corner, error; } Bound;

static inline Real size(Real x) { Real r; EACH(r, fabs(AT(x))); return r; }
static inline Real root(Real x) { Real r; EACH(r, sqrt(AT(x))); return r; }
static inline Real arctan(Real x) { Real r; EACH(r, atan(AT(x))); return r; }
static inline Real expo(Real x) { Real r; EACH(r, exp(AT(x))); return r; }
static inline Real clip(Real x, double low, double high) {
    Real r;
    EACH(r, AT(x) < low ? low : AT(x) > high ? high : AT(x));
    return r;
}

/* S_f and δ, both softened, at one speed. */
static inline Friction friction(const Case *c, Real v) {
    Friction f;
    f.angle = M_2_PI * arctan(c->beta * v);
    f.sign = f.angle * v * v / (v * v + c->blend * c->blend);
    f.share = 1 / (1 + expo((size(v) - c->threshold) / c->blend));
    f.delta = c->fast + (c->slow - c->fast) * f.share;
    return f;
}

/* One tick: ARC, then the axis under the held input; s becomes the state after it. */
static inline void tick(const Case *c, const Real theta[M], Desired d, State *s, Kept *k) {
    const double h = c->period;
    const Real rate = s->v - d.v, p = rate + c->k1 * (s->y - d.y), x = d.a - c->k1 * rate;
    Friction f = friction(c, s->v);
    const Real phi[M] = {x, s->v, f.sign, 1 + 0 * x};
    Real u = -c->k2 * p, mismatch = f.delta, v = s->v, gain = 0 * x;
    Real mean[W] = {gain, gain, gain, gain, gain};
    for (int j = 0; j < M; j++) {
        k->hat[j] = s->hat[j];
        u += phi[j] * s->hat[j];
        mismatch += size(phi[j]) * (c->upper[j] - c->lower[j]);
        s->hat[j] = clip(s->hat[j] - h * c->gamma[j] * phi[j] * p, c->lower[j], c->upper[j]);
    }
    u -= mismatch * mismatch * p / (4 * c->epsilon);
    k->v = v, k->p = p, k->x = x, k->mismatch = mismatch;
    for (int i = 0; i < STAGES; i++) {
        v = s->v + node[i] * h * gain;
        if (i) f = friction(c, v);
        k->speed[i] = v, k->at[i] = f;
        gain = (u - theta[1] * v - theta[2] * f.sign - theta[3]) / theta[0];
        mean[0] += weight[i] * gain;
        mean[1] += weight[i] * v;
        mean[2] += weight[i] * f.sign;
        mean[3] += weight[i];
        mean[4] += weight[i] * f.delta;
    }
    s->y += h * mean[1];
    s->v += h * mean[0];
    for (int j = 0; j < W; j++) s->passed[j] = c->keep * s->passed[j] + (1 - c->keep) * mean[j];
}

static inline Desired advance(Desired d, Real j, double t) {
    const Desired r = {d.y + t * (d.v + t * (d.a / 2 + t * j / 6)), d.v + t * (d.a + t * j / 2), d.a + t * j};
    return r;
}

/* The loop itself: filtered rows, and what the adjoint needs where there is room. */
static inline int forward(const Case *c, const Real *jerk, const Real *theta, Real *rows, Kept *kept) {
    const Real zero = 0 * jerk[0];
    State s = {zero, zero, {zero, zero, zero, zero}, {zero, zero, zero, zero, zero}};
    Kept unused;
    int k = 0;
    for (int j = 0; j < M; j++) s.hat[j] = zero + (c->lower[j] + c->upper[j]) / 2;
    for (int r = 0; r < c->repeats; r++) {
        Desired knot = {zero, zero, zero};
        for (int i = 0; i < c->intervals; i++) {
            for (int q = 0; q < c->per_interval; q++, k++) {
                tick(c, theta, advance(knot, jerk[i], q * c->period), &s, kept ? kept + k : &unused);
                for (int j = 0; j < W; j++) rows[W * k + j] = s.passed[j];
            }
            knot = advance(knot, jerk[i], c->knot_period);
        }
    }
    return k;
}

/* P x = b by elimination: P is positive definite. */
static void solve(const Real P[M][M], const Real b[M], Real x[M]) {
    Real A[M][M + 1];
    for (int i = 0; i < M; i++) {
        for (int j = 0; j < M; j++) A[i][j] = P[i][j];
        A[i][M] = b[i];
    }
    for (int i = 0; i < M; i++)
        for (int r = i + 1; r < M; r++) {
            const Real factor = A[r][i] / A[i][i];
            for (int j = i; j <= M; j++) A[r][j] -= factor * A[i][j];
        }
    for (int i = M - 1; i >= 0; i--) {
        x[i] = A[i][M];
        for (int j = i + 1; j < M; j++) x[i] -= A[i][j] * x[j];
        x[i] /= A[i][i];
    }
}

/* The weight of one row. */
static inline Real weight_of(const Case *c, const Bound *b, const Real *r) {
    const Real *m = b->mixture;
    return (m[0] * r[0] + m[1] * r[1] + m[2] * r[2] + m[3] * r[3]) * c->period;
}

/* (29), smoothed. */
static Bound bound_of(const Case *c, const Real *rows, int n) {
    const Real zero = 0 * rows[0];
    Real P[M][M], unit[M] = {zero, zero, zero, zero}, sum = zero;
    Bound b;
    for (int i = 0; i < M; i++)
        for (int j = 0; j < M; j++) P[i][j] = zero;
    for (int k = 0; k < n; k++)
        for (int i = 0; i < M; i++)
            for (int j = i; j < M; j++) P[i][j] += rows[W * k + i] * rows[W * k + j];
    for (int i = 0; i < M; i++)
        for (int j = 0; j < M; j++) b.P[i][j] = P[i < j ? i : j][i < j ? j : i] * c->period;
    unit[c->target] = zero + 1;
    solve(b.P, unit, b.mixture);
    for (int k = 0; k < n; k++) {
        const Real g = weight_of(c, &b, rows + W * k);
        sum += g * g;
    }
    b.corner = c->smoothing * root(sum / n);
    b.error = zero;
    for (int k = 0; k < n; k++) {
        const Real g = weight_of(c, &b, rows + W * k);
        b.error += root(g * g + b.corner * b.corner) * rows[W * k + M];
    }
    return b;
}

int row_size(void) { return W; }

/* log J of each lane. `work` has room for W Reals per tick. */
void loop_value(const Case *c, const Real *jerk, const Real *theta, Real *work, Real *value) {
    const int n = forward(c, jerk, theta, work, 0);
    const Bound b = bound_of(c, work, n);
    EACH(*value, log(AT(b.error)));
}

#if LANES == 1

int kept_size(void) { return sizeof(Kept); }

/* What the adjoints of P and of the corner add to every row: S = P̄ + P̄ᵀ, and a share of g. */
static double bound_adjoint(const Case *c, const Bound *b, const double *rows, int n, double S[M][M]) {
    double corner_bar = 0, straight[M] = {0}, sums[M] = {0}, mixture_bar[M], z[M];
    for (int k = 0; k < n; k++) {
        const double *r = rows + W * k, g = weight_of(c, b, r);
        const double share = r[M] / (sqrt(g * g + b->corner * b->corner) * b->error);
        corner_bar += b->corner * share;
        for (int j = 0; j < M; j++) {
            straight[j] += g * share * r[j];
            sums[j] += g * r[j];
        }
    }
    const double slide = corner_bar * c->smoothing * c->smoothing / (n * b->corner);
    for (int j = 0; j < M; j++) mixture_bar[j] = c->period * (straight[j] + slide * sums[j]);
    solve(b->P, mixture_bar, z);
    for (int i = 0; i < M; i++)
        for (int j = 0; j < M; j++) S[i][j] = -(z[i] * b->mixture[j] + b->mixture[i] * z[j]);
    return slide;
}

/* What (29) has to do with the filtered row of one tick: its cotangents. */
static inline void row_adjoint(
    const Case *c, const Bound *b, const double S[M][M], double slide, const double *r, double bar[W]
) {
    const double g = weight_of(c, b, r), hypotenuse = sqrt(g * g + b->corner * b->corner);
    const double g_bar = g * r[M] / (hypotenuse * b->error) + slide * g;
    for (int i = 0; i < M; i++) {
        bar[i] = g_bar * b->mixture[i];
        for (int j = 0; j < M; j++) bar[i] += S[i][j] * r[j];
        bar[i] *= c->period;
    }
    bar[M] = hypotenuse / b->error;
}

/* ∂S_f/∂v and ∂δ/∂v. */
static inline double sign_slope(const Case *c, double v, const Friction *f) {
    const double w2 = c->blend * c->blend, per = 1 / (v * v + w2), bv = c->beta * v;
    return M_2_PI * c->beta / (1 + bv * bv) * v * v * per + f->angle * 2 * v * w2 * per * per;
}

static inline double delta_slope(const Case *c, double v, const Friction *f) {
    return -copysign(c->slow - c->fast, v) * f->share * (1 - f->share) / c->blend;
}

/* The adjoint of `tick`: `s`, cotangents of the state after it, become those of the state before. */
static inline Desired tick_adjoint(
    const Case *c, const double theta[M], const Kept *k, const double bar[W], State *s
) {
    const double h = c->period;
    double mean[W], u_bar = 0, stage = 0, phi_bar[M], first_sign, first_delta, v_bar = s->v;
    for (int j = 0; j < W; j++) {
        s->passed[j] += bar[j];
        mean[j] = (1 - c->keep) * s->passed[j];
        s->passed[j] *= c->keep;
    }
    mean[1] += h * s->y;
    mean[0] += h * s->v;
    for (int i = STAGES - 1; i >= 0; i--) {
        const double later = i + 1 < STAGES ? node[i + 1] * h * stage : 0;
        const double gain = (weight[i] * mean[0] + later) / theta[0];
        first_sign = sign_slope(c, k->speed[i], k->at + i), first_delta = delta_slope(c, k->speed[i], k->at + i);
        u_bar += gain;
        stage = weight[i] * mean[1] - theta[1] * gain + first_sign * (weight[i] * mean[2] - theta[2] * gain) +
                first_delta * weight[i] * mean[4];
        v_bar += stage;
    }
    const double phi[M] = {k->x, k->v, k->at[0].sign, 1}, push = k->mismatch / (4 * c->epsilon);
    const double mismatch_bar = -2 * push * k->p * u_bar;
    double p_bar = -(c->k2 + k->mismatch * push) * u_bar;
    for (int j = 0; j < M; j++) {
        const double step = h * c->gamma[j], next = k->hat[j] - step * phi[j] * k->p;
        const double hat_bar = c->lower[j] <= next && next <= c->upper[j] ? s->hat[j] : 0;
        phi_bar[j] = u_bar * k->hat[j] + copysign(c->upper[j] - c->lower[j], phi[j]) * mismatch_bar -
                     step * k->p * hat_bar;
        p_bar -= step * phi[j] * hat_bar;
        s->hat[j] = hat_bar + u_bar * phi[j];
    }
    const double rate_bar = p_bar - c->k1 * phi_bar[0], e_bar = c->k1 * p_bar;
    s->v = v_bar + phi_bar[1] + first_sign * phi_bar[2] + first_delta * mismatch_bar + rate_bar;
    s->y += e_bar;
    const Desired d = {-e_bar, -rate_bar, phi_bar[0]};
    return d;
}

/* log J and its gradient. `work` has room for W doubles per tick, `kept` for a Kept per tick. */
void loop_value_and_gradient(
    const Case *c, const double *jerk, const double *theta, double *work, Kept *kept, double *value, double *gradient
) {
    const int n = forward(c, jerk, theta, work, kept);
    const Bound b = bound_of(c, work, n);
    const double T = c->knot_period;
    double S[M][M], slide = bound_adjoint(c, &b, work, n, S);
    State s = {0};
    int k = n - 1;
    *value = log(b.error);
    for (int i = 0; i < c->intervals; i++) gradient[i] = 0;
    for (int r = 0; r < c->repeats; r++) {
        Desired knot = {0}; /* cotangents of the knot that ends the interval */
        for (int i = c->intervals - 1; i >= 0; i--) {
            double jerk_bar = T * (T * T / 6 * knot.y + T / 2 * knot.v + knot.a);
            knot.a += T * (T / 2 * knot.y + knot.v);
            knot.v += T * knot.y;
            for (int q = c->per_interval - 1; q >= 0; q--, k--) {
                const double t = q * c->period;
                double bar[W];
                row_adjoint(c, &b, S, slide, work + W * k, bar);
                const Desired d = tick_adjoint(c, theta, kept + k, bar, &s);
                knot.y += d.y;
                knot.v += d.v + t * d.y;
                knot.a += d.a + t * (d.v + t / 2 * d.y);
                jerk_bar += t * (d.a + t / 2 * (d.v + t / 3 * d.y));
            }
            gradient[i] += jerk_bar;
        }
    }
}

#endif
