/* Functions of the programs: those of mechcore.kinematics.dyads, tables, motion curves, numpy's sign, maximum and minimum. */
#include <math.h>

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
