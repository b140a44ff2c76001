/* q'' = a(q, q', t) in windows of collocation, as mechcore.dynamics.integration has it for numpy.

Before this stands, generated, what makes the reduced equations M q'' + h = Q of one mechanism:
    static void reduced(p, m, q, v, t, d, near, out)
with parameters p, assembly modes m, coordinates q and their rates v, values d of prescribed drives (of each its coordinate and two
derivatives, then functions of the time), angles `near` from which others are followed (replaced by those found), and out: the lower triangle of M row by row, then Q - h, then rates of the
states of effects that integrate over the time: they come after the coordinates, each as a rate whose acceleration that is; then
additional outputs.
Beside it, of the same arguments, `ratios`: rates of joints relative to those of coordinates, and `forms`:
numbers for the forms of laws that have several. */

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define STEP 1e-7      /* of differences */
#define ROUNDING 1e-15 /* of the largest term of a position: a correction below that is none */
#define MOST 15        /* steps of Newton's method */
#define MOST_NODES 32  /* of a window */
#define NO_PART 1e-11  /* see dynamics.integration.collocation */
#define CHATTER 1e-5   /* and windows */
#define MOST_CUT 400.0
#define AT_START 20.0  /* and windows */
#define PLACES 33      /* see dynamics.segments */
#define FINER 96
#define ROUNDS 8
#define HEAD 10 /* numbers before the coordinates in what tells where windows begin */

typedef struct {
    long f, given, angles; /* freedoms and states, numbers of prescribed drives, angles that are followed */
    const double *p, *m, *scale;
    const double *laws; /* of the drives and of functions of the time: where the motion curve of each begins, then these; or 0 */
} System;

typedef struct {
    long s;
    const double *nodes, *once, *twice, *legendre; /* see collocation.Rule */
} Rule;

/* Values d (given) at a time, by the laws. */
static void by_laws(const System *y, double t, double *d) {
    for (long k = 0, law = 0; k < y->given; law++) {
        const double *own = y->laws + (long)y->laws[law];
        const long orders = k < DRIVES ? 3 : 1;
        for (long order = 0; order < orders; order++) d[k++] = curve(own, t, order);
    }
}

/* Accelerations a (f); NaN where the coordinates move no mass. M = L D L' is solved without pivots, as it is positive. */
static void accelerations(const System *y, const double *q, const double *v, double t, const double *d, double *near, double *a) {
    const long f = F;
    double l[F * (F + 1) / 2 + F + STATES + ADDITIONAL], x[F];
    reduced(y->p, y->m, q, v, t, d, near, l);
    const double *rhs = l + f * (f + 1) / 2;
    for (long i = 0; i < f; i++) {
        double *row = l + i * (i + 1) / 2;
        for (long j = 0; j < i; j++) {
            const double *other = l + j * (j + 1) / 2;
            double sum = row[j];
            for (long k = 0; k < j; k++) sum -= row[k] * other[k];
            row[j] = sum;
        }
        for (long j = 0; j < i; j++) {
            const double whole = row[j];
            row[j] = whole / l[j * (j + 1) / 2 + j];
            row[i] -= row[j] * whole;
        }
    }
    for (long i = 0; i < f; i++) {
        x[i] = rhs[i];
        for (long j = 0; j < i; j++) x[i] -= l[i * (i + 1) / 2 + j] * x[j];
    }
    for (long i = f - 1; i >= 0; i--) {
        a[i] = x[i] / l[i * (i + 1) / 2 + i];
        for (long j = i + 1; j < f; j++) a[i] -= l[j * (j + 1) / 2 + i] * a[j];
    }
    for (long i = 0; i < STATES; i++) a[F + i] = rhs[F + i];
}

/* Accelerations at all nodes (s, f) for coordinates and rates there. */
static void at_nodes(const System *y, const Rule *r, double t0, double h, const double *q, const double *v, const double *d,
                     const double *near, double *a) {
    double own[ANGLES + 1];
    memcpy(own, near, (size_t)y->angles * sizeof(double));
    for (long i = 0; i < r->s; i++)
        accelerations(y, q + i * y->f, v + i * y->f, t0 + h * r->nodes[i], d + i * y->given, own, a + i * y->f);
}

/* Accelerations at the nodes of a window, from the guess `a` (s, f); how many evaluations, 0 where Newton's method fails. */
static long solved(const System *y, const Rule *r, double t0, double h, const double *q0, const double *v0, const double *d,
                   const double *near, double *a, double tolerance, double *work) {
    const long s = r->s, f = y->f, n = s * f;
    double *q = work, *v = q + n, *found = v + n, *step = found + n, *drift = step + n, *changed = drift + n, *by = changed + n,
           *matrix = by + 2 * n * f;
    long *rows = (long *)(matrix + n * n);
    int known = 0;
    double last = INFINITY;
    for (long i = 0; i < s; i++)
        for (long k = 0; k < f; k++) drift[i * f + k] = q0[k] + h * r->nodes[i] * v0[k];
    for (long count = 1; count <= MOST; count++) {
        for (long i = 0; i < s; i++)
            for (long k = 0; k < f; k++) {
                double once = 0.0, twice = 0.0;
                for (long j = 0; j < s; j++) {
                    once += r->once[i * s + j] * a[j * f + k];
                    twice += r->twice[i * s + j] * a[j * f + k];
                }
                q[i * f + k] = drift[i * f + k] + h * h * twice;
                v[i * f + k] = v0[k] + h * once;
            }
        at_nodes(y, r, t0, h, q, v, d, near, found);
        for (long i = 0; i < n; i++) {
            step[i] = found[i] - a[i];
            if (!isfinite(step[i])) return 0;
        }
        if (!known) {
            double pace = 0.0, rate = 0.0;
            for (long i = 0; i < n; i++) {
                if (i % f >= F) continue; /* a state */
                pace = fmax(pace, fabs(v[i]) / y->scale[i % f]);
                rate = fmax(rate, fabs(found[i]) / y->scale[i % f]);
            }
            pace = fmax(pace, sqrt(rate));
            if (pace == 0.0) pace = 1.0;
            for (long b = 0; b < 2 * f; b++) { /* by the coordinates, then by their rates */
                double *x = b < f ? q : v, size = b < f ? y->scale[b] : pace * y->scale[b - f];
                for (long i = 0; i < s; i++) size = fmax(size, fabs(x[i * f + b % f]));
                for (long i = 0; i < s; i++) {
                    by[b * n + i] = x[i * f + b % f];
                    x[i * f + b % f] += STEP * size;
                }
                at_nodes(y, r, t0, h, q, v, d, near, changed);
                for (long i = 0; i < s; i++) x[i * f + b % f] = by[b * n + i];
                for (long i = 0; i < n; i++) by[b * n + i] = (changed[i] - found[i]) / (STEP * size);
            }
            for (long i = 0; i < n; i++)
                for (long j = 0; j < n; j++) {
                    const long node = (i / f) * s + j / f, b = j % f;
                    matrix[i * n + j] = (i == j) - h * h * by[b * n + i] * r->twice[node] - h * by[(f + b) * n + i] * r->once[node];
                }
            for (long i = 0; i < n * n; i++)
                if (!isfinite(matrix[i])) return 0;
            if (!factored(matrix, rows, n)) return 0;
            known = 1;
        }
        substituted(matrix, rows, step, n);
        for (long i = 0; i < n; i++) a[i] += step[i];
        double size = 0.0;
        int rounding = 1;
        for (long k = 0; k < f; k++) {
            double moved = 0.0, terms = 0.0;
            for (long i = 0; i < s; i++) {
                double change = 0.0, whole = 0.0;
                for (long j = 0; j < s; j++) {
                    change += r->twice[i * s + j] * step[j * f + k];
                    whole += fabs(r->twice[i * s + j]) * fabs(a[j * f + k]);
                }
                moved = fmax(moved, h * h * fabs(change));
                terms = fmax(terms, fabs(drift[i * f + k]) + h * h * whole);
            }
            size = fmax(size, moved);
            if (!(moved <= ROUNDING * terms)) rounding = 0;
        }
        if (size <= tolerance || rounding) return count;
        if (count > 2 && size > 0.5 * last) {
            if (size > 0.9 * last || count > 8) return 0;
            known = 0; /* the slopes have changed too much within the window */
        }
        last = size;
    }
    return 0;
}

static long room(long s, long f) { return 6 * s * f + 2 * s * f * f + s * f * s * f + s * f + 1; }

/* Accelerations of states (n, f). Angles are followed from each state to the next. */
void evaluated(const System *y, long n, const double *q, const double *v, const double *t, const double *d, const double *near,
               double *a) {
    double own[ANGLES + 1];
    memcpy(own, near, (size_t)y->angles * sizeof(double));
    for (long i = 0; i < n; i++) accelerations(y, q + i * y->f, v + i * y->f, t[i], d + i * y->given, own, a + i * y->f);
}

/* What `reduced` gives at states (n, F (F + 1) / 2 + F + STATES + ADDITIONAL). Angles are followed from each state to the next. */
void reduced_at(const System *y, long n, const double *q, const double *v, const double *t, const double *d, const double *near,
                double *out) {
    double own[ANGLES + 1];
    memcpy(own, near, (size_t)y->angles * sizeof(double));
    for (long i = 0; i < n; i++)
        reduced(y->p, y->m, q + i * y->f, v + i * y->f, t[i], d + i * y->given, own, out + i * (F * (F + 1) / 2 + F + STATES + ADDITIONAL));
}

/* The largest of the ratios at a state; NaN where one is. */
static double strained(const System *y, const double *q, const double *v, double t, const double *d, const double *near) {
    double found[RATIOS + 1], largest = 0.0;
    ratios(y->p, y->m, q, v, t, d, near, found);
    for (long i = 0; i < RATIOS; i++) largest = larger(largest, fabs(found[i]));
    return largest;
}

/* The same at states (n), with the same angles near. */
void strained_at(const System *y, long n, const double *q, const double *v, const double *t, const double *d, const double *near,
                 double *out) {
    for (long i = 0; i < n; i++) out[i] = strained(y, q + i * y->f, v + i * y->f, t[i], d + i * y->given, near);
}

/* M, Q - h and the largest ratio (n, 3) at rest at places (n) of the only coordinate, with assembly modes (n, count) of their own;
no angle is followed, and nothing is given. */
void resting(const System *y, long n, const double *q, const double *modes, long count, double *out) {
    const double still[F + STATES] = {0.0}, moving[F + STATES] = {1.0};
    double own[ANGLES + 1] = {0.0}, found[F * (F + 1) / 2 + F + STATES + ADDITIONAL];
    System at = *y;
    for (long i = 0; i < n; i++) {
        at.m = modes + i * count;
        reduced(at.p, at.m, q + i, still, 0.0, own, own, found);
        out[3 * i] = found[0], out[3 * i + 1] = found[1], out[3 * i + 2] = strained(&at, q + i, moving, 0.0, own, own);
    }
}

/* Forms of laws at states (n, FORMS). */
void formed(const System *y, long n, const double *q, const double *v, const double *t, const double *d, double *out) {
    for (long i = 0; i < n; i++) forms(y->p, y->m, q + i * y->f, v + i * y->f, t[i], d + i * y->given, 0, out + i * FORMS);
}

/* One window: `solved` with memory of its own. */
long window(const System *y, const Rule *r, double t0, double h, const double *q0, const double *v0, const double *d,
            const double *near, double *a, double tolerance) {
    double *work = malloc((size_t)room(r->s, y->f) * sizeof(double));
    if (!work) return 0;
    const long count = solved(y, r, t0, h, q0, v0, d, near, a, tolerance, work);
    free(work);
    return count;
}

/* Values of the polynomials of 2 x - 1 with coefficients `series` (s, f), and what they and their integrals make of q, v (f) at a
place x of a window; any of `q`, `v`, `a` may be 0. */
static void within(long s, long f, const double *series, double h, double x, const double *q0, const double *v0, double *q, double *v,
                   double *a) {
    const double z = 2.0 * x - 1.0;
    double p[MOST_NODES + 2], first[MOST_NODES + 1];
    p[0] = 1.0, p[1] = z;
    for (long k = 2; k < s + 2; k++) p[k] = ((2.0 * (double)k - 1.0) / (double)k) * (z * p[k - 1]) - (((double)k - 1.0) / (double)k) * p[k - 2];
    first[0] = 0.5 * (p[1] + 1.0);
    for (long k = 1; k < s + 1; k++) first[k] = 0.5 * (p[k + 1] - p[k - 1]) / (2.0 * (double)k + 1.0);
    for (long i = 0; i < f; i++) {
        double value = 0.0, once = 0.0, twice = 0.0;
        for (long k = 0; k < s; k++) {
            const double c = series[k * f + i];
            value += c * p[k];
            once += c * first[k];
            twice += c * (k ? 0.5 * (first[k + 1] - first[k - 1]) / (2.0 * (double)k + 1.0) : 0.5 * (first[1] + first[0]));
        }
        if (q) q[i] = q0[i] + h * x * v0[i] + h * h * twice;
        if (v) v[i] = v0[i] + h * once;
        if (a) a[i] = value;
    }
}

/* The first time in a window from t, later than `after`, at which a law changes its form; infinite where none does. As that of
segments.Breakpoints. */
static double broken(const System *y, long s, const double *series, double t, double h, const double *q0, const double *v0,
                     double after) {
    double low = fmax(after, t), high = t + h, q[F + STATES], v[F + STATES], d[GIVEN + 1], times[FINER + 1];
    const double start = low, whole = high - low;
    long count = PLACES + 2, k = 0;
    for (long i = 0; i < count; i++) times[i] = i == 0 ? low : i == count - 1 ? high : start + whole * (((double)i - 0.5) / PLACES);
    for (long round = 0; round < ROUNDS; round++) {
        double known[FORMS + 1], now[FORMS + 1];
        int changed = 0;
        for (long i = 0; i < count && !changed; i++) {
            within(s, y->f, series, h, (times[i] - t) / h, q0, v0, q, v, 0);
            by_laws(y, times[i], d);
            forms(y->p, y->m, q, v, times[i], d, 0, now);
            for (long j = 0; i && j < FORMS; j++) changed |= now[j] != known[j];
            memcpy(known, now, FORMS * sizeof(double));
            k = i - 1;
        }
        if (!changed) return INFINITY;
        const double apart = times[k + 1] - times[k];
        if (!(apart > 4.0 * (nextafter(fabs(times[k + 1]), INFINITY) - fabs(times[k + 1])))) break;
        if (round + 1 == ROUNDS) break;
        low = times[k];
        count = FINER + 1;
        for (long i = 0; i < count; i++) times[i] = i < FINER ? low + apart * ((double)i / FINER) : low + apart;
        k = 0;
    }
    return times[k + 1];
}

/* What the quadrature misses of the speed by coefficients (s) of one coordinate, as collocation.tails; the power of h goes into
`order`. */
static double missed(long s, long f, const double *series, double *order) {
    double last = 0.0, middle = 0.0, size = 0.0;
    for (long k = 0; k < s; k++) size = fmax(size, fabs(series[k * f]));
    for (long k = s - 2; k < s; k++) last = fmax(last, fabs(series[k * f]));
    for (long k = (s - 1) / 2; k < (s + 3) / 2; k++) middle = fmax(middle, fabs(series[k * f]));
    const double ratio = fmin(last / fmax(middle, 1e-300), 0.25), m = -log2(fmax(ratio, 1e-300));
    *order = fmin(*order, 0.5 * (m + 1.0));
    return last > NO_PART * size ? 2.0 * (double)s * last * ratio / (m - 1.0) : 0.0;
}

/* Windows one after the other, from (q, v, t) to the time `end`, `count` at the most: each is start, length, what `strained` gives at
its end, then q, v (f) at its start and Legendre coefficients (s, f) of the acceleration. How they are made longer and shorter is that of windows.integrate.

With `checked` they end where laws change their forms, and all end at the times `breaks` (infinite the last one), at which laws are
known to do so.

`at`: t, h, longest, evaluations, rejected, whether a window begins at a breakpoint, cuts of the present one, how long it would have
been, windows in a row that are cut to almost nothing, whether the last trial was too long; q, v, end_a (f), guess (s, f), near (angles): where it begins, and where it has ended.
The result is the number of windows, its negative less one where windows became too short. */
long windows(const System *y, const Rule *r, double end, double least, double most, double tolerance, double small, long count,
             long checked, const double *breaks, double *at, double *out) {
    const long s = r->s, f = y->f, n = s * f;
    double *q = at + HEAD, *v = q + f, *end_a = v + f, *guess = end_a + f, *near = guess + n;
    double *work = malloc((size_t)(room(s, f) + n + (s + 1) * (GIVEN + 1)) * sizeof(double));
    if (!work) return -1;
    double *a = work + room(s, f), *d = a + n;
    const double order = (double)(s + 1);
    long made = 0;
    while (made < count && at[0] < end - least) {
        double t = at[0], h = fmin(fmin(at[1], most), end - at[0]);
        if (t + 1.9 * h > end && t + h < end) h = 0.5 * (end - t);
        while (*breaks <= t + AT_START * least) breaks++;
        if (at[6] == 0.0 && *breaks < t + h * (1.0 - 1e-10)) at[6] = 1.0, at[7] = h, h = *breaks - t;
        for (long i = 0; i <= s; i++) by_laws(y, t + h * (i < s ? r->nodes[i] : 1.0), d + i * y->given);
        memcpy(a, guess, (size_t)n * sizeof(double));
        const long evaluations = solved(y, r, t, h, q, v, d, near, a, small, work);
        double worst = INFINITY, power = order, *series = out + 4 + 2 * f;
        at[3] += evaluations ? (double)evaluations : 8.0;
        if (evaluations) {
            const double longest = fmax(at[2], h);
            worst = 0.0;
            for (long i = 0; i < s; i++)
                for (long k = 0; k < f; k++) {
                    double sum = 0.0;
                    for (long j = 0; j < s; j++) sum += r->legendre[i * s + j] * a[j * f + k];
                    series[i * f + k] = sum;
                }
            if (checked && at[6] < 5.0) {
                const double until = broken(y, s, series, t, h, q, v, t + AT_START * least);
                if (until < t + h * (1.0 - 1e-10)) {
                    at[6] += 1.0, at[7] = fmax(at[7], h), at[1] = until - t;
                    for (long i = 0; i < s; i++) within(s, f, series, h, at[1] * r->nodes[i] / h, q, v, 0, 0, guess + i * f);
                    continue;
                }
            }
            for (long k = 0; k < f; k++)
                for (long i = s - 2; i < s; i++)
                    worst = fmax(worst, h * longest * fabs(series[i * f + k]) / (4.0 * (double)(i * i)) / (tolerance * y->scale[k]));
            if (at[5] != 0.0 || at[6] > 0.0) {
                double rough = 0.0, own = INFINITY;
                for (long k = 0; k < f; k++) rough = fmax(rough, h * longest * missed(s, f, series + k, &own) / (tolerance * y->scale[k]));
                if (MARGIN * rough > worst) worst = MARGIN * rough, power = own;
            }
            if (worst > MARGIN && h < 1e4 * least) worst = MARGIN;
        }
        if (!(worst <= MARGIN)) {
            at[4] += 1.0;
            h *= isfinite(worst) ? fmin(fmax(0.8 * pow(1.0 / worst, 1.0 / power), 0.1), 0.7) : 0.3;
            at[1] = h;
            at[6] = 0.0;
            at[9] = 1.0;
            if (h < 1e3 * least) {
                free(work);
                return -made - 1;
            }
            for (long i = 1; i < s; i++) memcpy(guess + i * f, guess, (size_t)f * sizeof(double));
            continue;
        }
        at[2] = fmax(at[2], h);
        at[8] = checked && h < CHATTER * at[2] ? at[8] + 1.0 : 0.0;
        if (at[8] > MOST_CUT) break;
        out[0] = t;
        out[1] = h;
        out[3] = (double)(at[6] > 0.0);
        memcpy(out + 4, q, (size_t)(2 * f) * sizeof(double));
        const double longer = h * fmin(fmax(0.9 * pow(1.0 / fmax(worst, 1e-12), 1.0 / power), 0.3), at[9] > 0.0 ? 1.0 : 1.6);
        at[9] = 0.0;
        double away = 0.0, spread = 0.0;
        for (long k = 0; k < f; k++) {
            const double first = series[k], second = s > 1 ? series[f + k] : 0.0;
            q[k] += h * v[k] + h * h * (0.5 * first - second / 6.0);
            v[k] += h * first;
            end_a[k] = 0.0;
            for (long i = 0; i < s; i++) {
                end_a[k] += series[i * f + k];
                spread += fabs(series[i * f + k]);
            }
        }
        for (long i = 0; i < s; i++) { /* the polynomials of 2 x - 1 at x beyond the end */
            const double z = 1.0 + 2.0 * (longer / h) * r->nodes[i];
            double before = 1.0, now = z;
            for (long k = 0; k < f; k++) guess[i * f + k] = series[k] + (s > 1 ? z * series[f + k] : 0.0);
            for (long j = 2; j < s; j++) {
                const double next = ((2.0 * (double)j - 1.0) * z * now - ((double)j - 1.0) * before) / (double)j;
                before = now;
                now = next;
                for (long k = 0; k < f; k++) guess[i * f + k] += now * series[j * f + k];
            }
            for (long k = 0; k < f; k++) away = fmax(away, fabs(guess[i * f + k] - end_a[k]));
        }
        if (at[7] > 0.0 || !(away <= 4.0 * spread + 1e-300))
            for (long i = 0; i < s; i++) memcpy(guess + i * f, end_a, (size_t)f * sizeof(double));
        if (y->angles) { /* followed over the nodes to the end of the window */
            for (long i = 0; i < s; i++) accelerations(y, work + i * f, work + n + i * f, t + h * r->nodes[i], d + i * y->given, near, a);
            accelerations(y, q, v, t + h, d + s * y->given, near, a);
        }
        out[2] = strained(y, q, v, t + h, d + s * y->given, near);
        at[0] = t + h;
        at[1] = fmax(longer, 0.5 * at[7]);
        at[5] = (double)(at[6] > 0.0);
        at[6] = at[7] = 0.0;
        out += 4 + 2 * f + n;
        made++;
    }
    free(work);
    return made;
}
