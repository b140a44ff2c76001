/* Functions of the programs: those of mechcore.kinematics.dyads, tables, motion curves, numpy's sign, maximum and minimum, linear
   equations, Newton's method, the normal loads of friction and what sticks. */
#include <math.h>
#include <string.h>

static inline double four_areas(double a, double b, double d, double rounding) {
    const double total = a + b, difference = fabs(a - b), gap = total - d, spare = d - difference;
    const double product = (total + d) * gap * spare * (d + difference), least = -rounding * total;
    return sqrt(product < 0.0 && gap > least && spare > least ? 0.0 : product);
}
static inline double leg(double r, double y, double rounding) {
    const double product = (r - y) * (r + y);
    return sqrt(product < 0.0 && fabs(y) - r < rounding * r ? 0.0 : product);
}
static inline double piecewise(const double *p, long n, double x) { /* n + 1 borders, then 4 coefficients of each piece */
    long low = 0, high = n;
    while (high - low > 1) {
        const long middle = (low + high) / 2;
        if (x < p[middle]) high = middle;
        else low = middle;
    }
    const double *c = p + n + 1 + 4 * low, z = x - p[low];
    return ((c[0] * z + c[1]) * z + c[2]) * z + c[3];
}
static inline double searched(const double *p, long n, double x) { /* how many of n numbers in order are not greater */
    long low = 0, high = n;
    while (low < high) {
        const long middle = (low + high) / 2;
        if (x < p[middle]) high = middle;
        else low = middle + 1;
    }
    return (double)low;
}
static inline double knot(const double *p, double k) { return p[(long)k]; }
static inline double curve(const double *p, double x, long derivative) {
    /* a motion curve: n, start, period (0: none), advance, n + 1 knots, where each piece stands; a piece is the length of its
       polynomial, coefficients upwards, how many waves, of each its circular frequency and amplitudes of sine and cosine */
    const long n = (long)p[0];
    const double *knots = p + 4, turns = p[2] > 0.0 ? floor((x - p[1]) / p[2]) : 0.0;
    if (!(x - x == 0.0)) return x - x;
    if (turns != 0.0) {
        x -= turns * p[2];
        x = x < knots[0] ? knots[0] : x > knots[n] ? knots[n] : x;
    }
    const double k = searched(knots + 1, n - 1, x);
    const double *piece = p + (long)knots[n + 1 + (long)k], *waves;
    const double u = x - knots[(long)k];
    double value = 0.0;
    for (long j = (long)piece[0] - 1; j >= derivative; j--) {
        double factor = 1.0;
        for (long i = 0; i < derivative; i++) factor *= (double)(j - i);
        value = value * u + factor * piece[1 + j];
    }
    waves = piece + 1 + (long)piece[0];
    for (long m = 0; m < (long)waves[0]; m++) {
        const double w = waves[1 + 3 * m], a = waves[2 + 3 * m], b = waves[3 + 3 * m], s = sin(w * u), c = cos(w * u);
        double factor = derivative % 4 == 2 || derivative % 4 == 3 ? -1.0 : 1.0;
        for (long i = 0; i < derivative; i++) factor *= w;
        value += factor * (derivative % 2 ? a * c - b * s : a * s + b * c);
    }
    return derivative ? value : value + turns * p[3];
}
static inline double known(double x) { return (double)(x - x == 0.0); }
static inline double length(double x, double y) { return sqrt(x * x + y * y); }
static inline double modulo(double a, double b) {
    const double rest = fmod(a, b);
    return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest;
}
static inline double sign(double x) { return (double)((x > 0.0) - (x < 0.0)) + 0.0 * x; }
static inline double larger(double a, double b) { return a != a || a > b ? a : b; }
static inline double smaller(double a, double b) { return a != a || a < b ? a : b; }

/* Matrix (n, n) in place as L U with row exchanges; the sign of its determinant, 0 where it is singular. */
static inline int factored(double *m, long *rows, long n) {
    int sign = 1;
    for (long k = 0; k < n; k++) {
        long best = k;
        for (long i = k + 1; i < n; i++)
            if (fabs(m[i * n + k]) > fabs(m[best * n + k])) best = i;
        if (!(fabs(m[best * n + k]) > 0.0)) return 0;
        rows[k] = best;
        sign = (best != k) != (m[best * n + k] < 0.0) ? -sign : sign;
        if (best != k)
            for (long j = 0; j < n; j++) {
                const double other = m[k * n + j];
                m[k * n + j] = m[best * n + j];
                m[best * n + j] = other;
            }
        for (long i = k + 1; i < n; i++) {
            const double part = m[i * n + k] /= m[k * n + k];
            for (long j = k + 1; j < n; j++) m[i * n + j] -= part * m[k * n + j];
        }
    }
    return sign;
}

static inline void substituted(const double *m, const long *rows, double *x, long n) {
    for (long k = 0; k < n; k++) {
        const double other = x[k];
        x[k] = x[rows[k]];
        x[rows[k]] = other;
    }
    for (long j = 0; j < n; j++) /* column by column: no term waits for the one before */
        for (long i = j + 1; i < n; i++) x[i] -= m[i * n + j] * x[j];
    for (long j = n - 1; j >= 0; j--) {
        x[j] /= m[j * n + j];
        for (long i = 0; i < j; i++) x[i] -= m[i * n + j] * x[j];
    }
}
static inline double linear(double *x, const long *s, const double *g) { /* linear equations: matrix (n, n), right-hand side (n) */
    const long n = s[0];
    double m[n * n];
    long rows[n];
    memcpy(m, g, (size_t)(n * n) * sizeof(double));
    memcpy(x, g + n * n, (size_t)n * sizeof(double));
    const int sign = factored(m, rows, n);
    if (sign) substituted(m, rows, x, n);
    else
        for (long i = 0; i < n; i++) x[i] = NAN;
    return sign;
}

/* A group's loops and relations by Newton's method as mechcore.numerics.newton: n unknowns x, angles first, from where they are
guessed to be. `s`: how many are angles, n, loops, relations, whether x may only go on from the guess on its branch; then of each
loop how many vectors unknowns turn, their numbers, how many guides, the number of each unknown and of the angle that turns it or
-1; of each relation how many unknowns, their numbers. `g`: the guess, the tolerance, what kinematics.positions.block_equations says. */
static inline double newton(double *x, const long *s, const double *g) {
    const long angles = s[0], n = s[1], loops = s[2], relations = s[3], tied = s[4];
    const double tolerance = g[n];
    double here[n], m[n * n], r[n], re[n], im[n], best = INFINITY;
    long rows[n];
    int first = 0, sign = 0;
    memcpy(x, g, (size_t)n * sizeof(double));
    memcpy(here, g, (size_t)n * sizeof(double));
    for (long count = 0; count < 30; count++) {
        const long *at = s + 5;
        const double *own = g + n + 1;
        memset(m, 0, (size_t)(n * n) * sizeof(double));
        for (long k = 0; k < angles; k++) re[k] = cos(here[k]), im[k] = sin(here[k]);
        for (long i = 0; i < loops; i++) {
            double *across = m + 2 * i * n, *up = across + n, u = *own++, v = *own++;
            for (long left = *at++; left; left--, own += 2) {
                const long k = *at++;
                const double a = own[0] * re[k] - own[1] * im[k], b = own[0] * im[k] + own[1] * re[k];
                u += a, v += b, across[k] -= b, up[k] += a;
            }
            for (long left = *at++; left; left--, own += 2) {
                const long k = *at++, carrier = *at++;
                double a = own[0], b = own[1];
                if (carrier >= 0) {
                    a = own[0] * re[carrier] - own[1] * im[carrier], b = own[0] * im[carrier] + own[1] * re[carrier];
                    across[carrier] -= here[k] * b, up[carrier] += here[k] * a;
                }
                u += here[k] * a, v += here[k] * b, across[k] += a, up[k] += b;
            }
            r[2 * i] = u, r[2 * i + 1] = v;
        }
        for (long i = 2 * loops; i < 2 * loops + relations; i++) {
            r[i] = *own++;
            for (long left = *at++; left; left--) {
                const long k = *at++;
                r[i] += *own * here[k], m[i * n + k] = *own++;
            }
        }
        double size = 0.0, longest = 0.0;
        for (long i = 0; i < n; i++) size = fabs(r[i]) <= size ? size : fabs(r[i]); /* NaN where one is */
        const int gain = size < 0.5 * best && size > tolerance, better = size < best;
        sign = factored(m, rows, n);
        if (count == 0) first = sign;
        if (better) best = size, memcpy(x, here, (size_t)n * sizeof(double));
        if (!sign || size != size || (!gain && (count >= 12 || best <= fmax(1e-8, tolerance)))) break;
        substituted(m, rows, r, n);
        for (long i = 0; i < n; i++) longest = fmax(longest, fabs(r[i]));
        for (long i = 0; i < n; i++) here[i] -= longest > 1.0 ? r[i] / longest : r[i]; /* never more than a radian at once */
    }
    int lost = !(best < fmax(1e-9, 10.0 * tolerance)) || (tied && sign != first);
    for (long i = 0; tied && i < n; i++) lost |= !(fabs(x[i] - g[i]) < 0.5);
    for (long i = 0; lost && i < n; i++) x[i] = NAN;
    return best;
}

/* g = |a + K g| as mechcore.forces.friction.normal_loads where the map contracts: loads (n), the error of their equations, the
steps taken, and whether they are found so. `s`: n, of each load whether it is the length of its two numbers, else the larger one; `d`: tolerance,
a (n, 2), K (n, 2, n). */
static inline double rubbing(double *x, const long *s, const double *d) {
    const long n = s[0], *lengths = s + 1;
    const double tolerance = d[0], *a = d + 1, *k = a + 2 * n;
    double m[n * n], f[n], next[n], y[n], bound = INFINITY, miss = NAN;
    long rows[n];
    int finite = 1;
    x[n] = NAN, x[n + 1] = 0.0, x[n + 2] = 1.0;
    for (long i = 0; i < 2 * n; i++) finite &= isfinite(a[i]) != 0;
    for (long i = 0; i < n; i++) next[i] = 1.0;
    for (long round = 0; round < 8 && !(bound < 1.0); round++) {
        double most = 0.0, largest = 0.0;
        for (long i = 0; i < n; i++) {
            y[i] = 0.0;
            for (long j = 0; j < n; j++) {
                const double p = fabs(k[2 * n * i + j]), q = fabs(k[2 * n * i + n + j]);
                y[i] += (lengths[i] ? length(p, q) : larger(p, q)) * next[j];
            }
            most = larger(most, y[i] / next[i]), largest = fmax(largest, y[i]);
        }
        bound = smaller(bound, most);
        finite &= isfinite(bound) != 0;
        for (long i = 0; i < n; i++) next[i] = y[i] / fmax(largest, 1e-300) + 1e-2;
    }
    for (long i = 0; i < n; i++) x[i] = finite ? 0.0 : NAN;
    if (!finite) return NAN; /* nothing is known there */
    x[n + 2] = (double)(bound < 1.0);
    if (!(bound < 1.0)) return bound;
    for (long i = 0; i < n; i++) next[i] = lengths[i] ? length(a[2 * i], a[2 * i + 1]) : larger(fabs(a[2 * i]), fabs(a[2 * i + 1]));
    for (long step = 0, plain = 0; step <= 400; step++) {
        double worst = 0.0;
        for (long i = 0; i < n; i++) {
            const double *first = k + 2 * n * i, *second = first + n;
            double p = a[2 * i], q = a[2 * i + 1], terms = fabs(p) + fabs(q), u, v, size;
            for (long j = 0; j < n; j++) {
                p += first[j] * next[j], q += second[j] * next[j];
                terms += (fabs(first[j]) + fabs(second[j])) * fabs(next[j]);
            }
            if (lengths[i]) size = length(p, q), u = size > 0.0 ? p / size : 0.0, v = size > 0.0 ? q / size : 0.0;
            else size = larger(fabs(p), fabs(q)), u = fabs(p) >= fabs(q) ? sign(p) : 0.0, v = fabs(p) >= fabs(q) ? 0.0 : sign(q);
            y[i] = next[i] - size;
            worst = larger(worst, fabs(y[i]) / fmax(terms, 1e-300));
            for (long j = 0; j < n; j++) m[n * i + j] = (i == j) - u * first[j] - v * second[j];
        }
        if (step && !plain && !(worst < 0.7 * miss)) {
            if (miss <= 1e-11) break; /* as close as rounding lets it come */
            for (long i = 0; i < n; i++) next[i] = x[i] - f[i]; /* a fixed-point step in its place */
            plain = 1;
            continue;
        }
        plain = 0, miss = worst;
        memcpy(x, next, (size_t)n * sizeof(double));
        memcpy(f, y, (size_t)n * sizeof(double));
        if (miss <= tolerance || !factored(m, rows, n)) break;
        substituted(m, rows, y, n);
        for (long i = 0; i < n; i++) next[i] = x[i] - y[i];
        x[n + 1] += 1.0;
    }
    x[n] = miss;
    if (!(miss <= fmax(1e-11, tolerance))) x[n + 2] = 0.0;
    return miss;
}

/* Eigenvalues of a symmetric matrix (n, n) on its diagonal, and its eigenvectors in the columns of v, by Jacobi's rotations. */
static inline void diagonalised(double *m, double *v, long n) {
    for (long i = 0; i < n * n; i++) v[i] = (double)(i % (n + 1) == 0);
    for (long sweep = 0; sweep < 50; sweep++) {
        double off = 0.0, on = 0.0;
        for (long i = 0; i < n; i++)
            for (long j = 0; j < n; j++) *(i == j ? &on : &off) += m[i * n + j] * m[i * n + j];
        if (!(off > 1e-40 * on)) return;
        for (long p = 0; p < n; p++)
            for (long q = p + 1; q < n; q++) {
                if (m[p * n + q] == 0.0) continue;
                const double half = 0.5 * (m[q * n + q] - m[p * n + p]) / m[p * n + q];
                const double t = (half < 0.0 ? -1.0 : 1.0) / (fabs(half) + sqrt(half * half + 1.0)), c = 1.0 / sqrt(t * t + 1.0);
                for (long i = 0; i < n; i++) { /* columns, those of v too, then rows */
                    double *const pairs[] = {m + i * n + p, m + i * n + q, v + i * n + p, v + i * n + q};
                    for (long k = 0; k < 4; k += 2) {
                        const double first = *pairs[k], second = *pairs[k + 1];
                        *pairs[k] = c * (first - t * second), *pairs[k + 1] = c * (second + t * first);
                    }
                }
                for (long i = 0; i < n; i++) {
                    const double first = m[p * n + i], second = m[q * n + i];
                    m[p * n + i] = c * (first - t * second), m[q * n + i] = c * (second + t * first);
                }
            }
    }
}

/* Dry friction of elements of which some stick, as mechcore.dynamics.contact.dry_friction: its values (n), sizes of the normal loads
(n), whether they are found. `s`: n, of each load whether it is the length of its two numbers; `d`: tolerance, signs of the
rates (n), friction per normal load against them (n), scales (n), relative accelerations without friction (n) and by unit friction
(n, n), the loads' numbers a (n, 2) without and (n, 2, n) by unit friction. */
static inline double dry(double *x, const long *s, const double *d) {
    const long n = s[0];
    const double *signs = d + 1, *braking = signs + n, *scale = braking + n, *bias = scale + n, *coupling = bias + n, *a = coupling + n * n,
                 *k = a + 2 * n;
    long stuck[n + 1], slides[n + 1], lengths[n + 1], count = 0, rest = 0;
    for (long i = 0; i < n; i++) {
        if (signs[i] == 0.0) stuck[count++] = i;
        else lengths[rest + 1] = s[1 + i], slides[rest++] = i;
    }
    lengths[0] = rest;
    double inner[count * count + 1], vectors[count * count + 1], need[count * count + 1], held[count * (rest + 1) + 1], most = 0.0;
    for (long i = 0; i < count * count; i++) {
        const long p = stuck[i / count], q = stuck[i % count];
        inner[i] = coupling[p * n + q] / (scale[p] * scale[q]), need[i] = 0.0;
    }
    diagonalised(inner, vectors, count);
    for (long i = 0; i < count; i++) most = fmax(most, fabs(inner[i * count + i]));
    for (long e = 0; e < count; e++) {
        const double value = inner[e * count + e];
        if (!(fabs(value) > 1e-10 * most)) continue; /* efforts that nothing determines */
        for (long i = 0; i < count * count; i++) need[i] += vectors[i / count * count + e] * vectors[i % count * count + e] / value;
    }
    for (long i = 0; i < count * count; i++) need[i] /= scale[stuck[i / count]] * scale[stuck[i % count]];
    for (long i = 0; i < count; i++)
        for (long j = 0; j <= rest; j++) { /* by loads of what slides, and last without */
            double sum = 0.0;
            for (long m = 0; m < count; m++)
                sum -= need[i * count + m] * (j < rest ? coupling[stuck[m] * n + slides[j]] * braking[slides[j]] : bias[stuck[m]]);
            held[i * (rest + 1) + j] = sum;
        }
    double given[1 + 2 * rest + 2 * rest * rest], loads[rest + 3];
    given[0] = d[0], loads[rest + 2] = 1.0;
    for (long i = 0; i < 2 * rest; i++) {
        const long row = 2 * slides[i / 2] + i % 2;
        for (long j = 0; j <= rest; j++) {
            double sum = j < rest ? braking[slides[j]] * k[row * n + slides[j]] : a[row];
            for (long m = 0; m < count; m++) sum += k[row * n + stuck[m]] * held[m * (rest + 1) + j];
            given[j < rest ? 1 + 2 * rest + i * rest + j : 1 + i] = sum;
        }
    }
    if (rest) rubbing(loads, lengths, given);
    for (long j = 0; j < rest; j++) x[slides[j]] = braking[slides[j]] * loads[j];
    for (long i = 0; i < count; i++) {
        x[stuck[i]] = held[i * (rest + 1) + rest];
        for (long j = 0; j < rest; j++) x[stuck[i]] += held[i * (rest + 1) + j] * loads[j];
    }
    for (long i = 0; i < n; i++) {
        double p = a[2 * i], q = a[2 * i + 1];
        for (long j = 0; j < n; j++) p += k[2 * i * n + j] * x[j], q += k[(2 * i + 1) * n + j] * x[j];
        x[n + i] = s[1 + i] ? length(p, q) : larger(fabs(p), fabs(q));
    }
    return x[2 * n] = loads[rest + 2];
}
