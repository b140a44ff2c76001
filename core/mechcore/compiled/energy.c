/* Motions that go round for ever under forces of the position alone, by their energy: see `mechcore.dynamics.equations.energy`.
   Tables are Chebyshev series on panels, as `mechcore.numerics.chebyshev` has them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { NODES = 16, TERMS = NODES + 1, SAMPLES = 24, MOST = 4096, LEVELS = 50 };

static void polynomials(double z, double *t) {
    t[0] = 1.0, t[1] = z;
    for (int k = 2; k < TERMS; k++) t[k] = 2.0 * z * t[k - 1] - t[k - 2];
}

static double sum(const double *c, long step, const double *t, int terms) {
    double value = 0.0;
    for (int k = 0; k < terms; k++) value += c[k * step] * t[k];
    return value;
}

/* The integral (TERMS) of a series on a panel of some width, with its value at the left boundary; returns that at the right one. */
static double integrated(const double *c, long step, double width, double left, double *out) {
    double begins = 0.0, ends = 0.0;
    out[0] = 0.0;
    for (int k = 1; k < TERMS; k++) {
        const double low = c[(k - 1) * step] * (k == 1 ? 2.0 : 1.0), high = k + 1 < NODES ? c[(k + 1) * step] : 0.0;
        out[k] = 0.25 * width * (low - high) / k;
        begins += k % 2 ? -out[k] : out[k], ends += out[k];
    }
    out[0] = left - begins;
    return out[0] + ends;
}

typedef struct {
    long panels;
    double low, width, turn; /* work of a turn */
    const double *c;         /* (panels, NODES, 2): inertia and force */
    double *work;            /* (panels, TERMS) */
} Curve;

/* Inertia at a place, and the work from the start of the table on. */
static double inertia_and_work(const Curve *s, double q, double *work) {
    const double u = (q - s->low) / s->width, turns = floor(u / (double)s->panels);
    double t[TERMS];
    long cell = (long)floor(u - turns * (double)s->panels);
    cell = cell < 0 ? 0 : cell >= s->panels ? s->panels - 1 : cell;
    const double z = 2.0 * (u - turns * (double)s->panels - (double)cell) - 1.0;
    polynomials(z < -1.0 ? -1.0 : z > 1.0 ? 1.0 : z, t);
    *work = turns * s->turn + sum(s->work + TERMS * cell, 1, t, TERMS);
    return sum(s->c + 2 * NODES * cell, 2, t, NODES);
}

typedef struct {
    double low, high, before, tail, c[NODES];
} Panel;

static int in_order(const void *a, const void *b) {
    const double x = ((const Panel *)a)->low, y = ((const Panel *)b)->low;
    return (x > y) - (x < y);
}

/* Whether from q on, at a rate v, no place is too high, and a turn brings nothing but rounding: then out has the panels (n) of a
   turn's time, first all n + 1 boundaries, then (n, TERMS, 2) of dt/du and t; returns n, 0 where that is not so or not found.
   limits: tolerance, noise, no_gain, small, least of the energies that are left. */
long rounds(long panels, double low, double width, const double *table, double q, double v, const double *fit, const double *nodes,
            const double *limits, long first, double *out) {
    double *work = malloc(sizeof(double) * (size_t)(panels * TERMS)), largest = 0.0, lowest = 0.0, left = 0.0, done, z[TERMS];
    Panel *all = malloc(sizeof(Panel) * 2 * (MOST + 2)), *fine = all + MOST + 2;
    Curve curve = {panels, low, width, 0.0, table, work};
    long count = first, total = 0, kept = 0;
    for (long p = 0; work && p < panels; p++) {
        double *own = work + TERMS * p, sizes = 0.0;
        left = integrated(table + 2 * NODES * p + 1, 2, width, left, own);
        for (int k = 0; k < TERMS; k++) sizes += fabs(own[k]);
        largest = sizes > largest ? sizes : largest;
        for (int k = 0; k < SAMPLES; k++) {
            polynomials(-1.0 + 2.0 * k / (SAMPLES - 1), z);
            const double here = sum(own, 1, z, TERMS);
            lowest = here < lowest || !(p || k) ? here : lowest;
        }
    }
    if (!work || !all) goto none;
    curve.turn = left;
    const double inertia = inertia_and_work(&curve, q, &done), kinetic = 0.5 * inertia * v * v;
    const double within = done - floor((q - low) / (width * (double)panels)) * curve.turn;
    if (!(fabs(curve.turn) <= limits[2] * largest && kinetic >= limits[3] * largest && kinetic + lowest - within > limits[4] * largest))
        goto none;
    const double length = copysign(width * (double)panels, v);
    double most = 0.0, worst = 0.0;
    for (long k = 0; k < count; k++) {
        all[k].low = (double)k / (double)first, all[k].high = (double)(k + 1) / (double)first;
        all[k].before = INFINITY;
    }
    while (count) {
        int give_up = (total += count) > MOST;
        for (long k = 0; k < count; k++) {
            Panel *p = all + k;
            double rate[NODES], size = 0.0;
            const double half = 0.5 * (p->high - p->low), middle = p->low + half;
            for (int i = 0; i < NODES; i++) {
                double so_far;
                const double j = inertia_and_work(&curve, q + length * (middle + half * nodes[i]), &so_far);
                const double energy = kinetic + (so_far - done);
                rate[i] = fabs(length) * sqrt(0.5 * (j > 0.0 ? j : 0.0) / (energy > 1e-300 ? energy : 1e-300));
            }
            for (int i = 0; i < NODES; i++) {
                p->c[i] = sum(fit + NODES * i, 1, rate, NODES);
                size = fabs(p->c[i]) > size ? fabs(p->c[i]) : size;
            }
            most = size > most ? size : most;
            if (!(size < INFINITY)) goto none;
        }
        long more = 0;
        Panel *halves = malloc(sizeof(Panel) * (size_t)(2 * count + 1));
        if (!halves) goto none;
        for (long k = 0; k < count; k++) {
            Panel *p = all + k;
            p->tail = 0.0;
            for (int i = NODES - 3; i < NODES; i++) p->tail = fabs(p->c[i]) / most > p->tail ? fabs(p->c[i]) / most : p->tail;
            if (give_up || p->tail <= limits[0] || (p->before < limits[1] && p->tail > 0.3 * p->before)) {
                worst = p->tail > worst ? p->tail : worst;
                fine[kept++] = *p;
            } else {
                const double middle = 0.5 * (p->low + p->high);
                halves[more] = halves[more + 1] = *p;
                halves[more].high = halves[more + 1].low = middle;
                halves[more].before = halves[more + 1].before = p->tail;
                more += 2;
            }
        }
        if (kept + more > MOST) more = 0, worst = INFINITY;
        memcpy(all, halves, sizeof(Panel) * (size_t)more);
        free(halves);
        count = more;
    }
    if (!(worst <= 1e-6)) goto none;
    qsort(fine, (size_t)kept, sizeof(Panel), in_order);
    left = 0.0;
    for (long k = 0; k < kept; k++) {
        double *own = out + kept + 1 + 2 * TERMS * k, clock[TERMS];
        out[k] = fine[k].low;
        left = integrated(fine[k].c, 1, fine[k].high - fine[k].low, left, clock);
        for (int i = 0; i < TERMS; i++) own[2 * i] = i < NODES ? fine[k].c[i] : 0.0, own[2 * i + 1] = clock[i];
    }
    out[kept] = 1.0;
    free(work), free(all);
    return kept;
none:
    free(work), free(all);
    return 0;
}

/* The parameter u and dt/du (n) at times within a leg, whose panels (count) have clocks that begin at edges (count + 1). */
void clocked(long count, const double *boundaries, const double *edges, const double *c, double last, long n, const double *time,
             double *out) {
    for (long m = 0; m < n; m++) {
        const double local = time[m] < 0.0 ? 0.0 : time[m] > edges[count] ? edges[count] : time[m];
        double t[TERMS], rate = 1.0, change = 1.0;
        long cell = 0, end = count; /* the last panel that begins at the time or before */
        while (end - cell > 1) {
            const long middle = (cell + end) / 2;
            if (edges[middle] <= local) cell = middle;
            else end = middle;
        }
        const double begin = boundaries[cell], width = boundaries[cell + 1] - begin;
        const double *own = c + 2 * TERMS * cell;
        double low = begin, high = begin + width, u = low + (local - edges[cell]) / (edges[cell + 1] - edges[cell]) * width;
        for (int k = 0; k < LEVELS; k++) {
            const double z = 2.0 * (u - begin) / width - 1.0;
            polynomials(z < -1.0 ? -1.0 : z > 1.0 ? 1.0 : z, t);
            rate = sum(own, 2, t, NODES);
            if (!(change >= last)) break;
            const double error = sum(own + 1, 2, t, TERMS) - local;
            if (error > 0.0) high = u < high ? u : high;
            else low = u > low ? u : low;
            double next = u - error / rate;
            if (!(next >= low && next <= high)) next = 0.5 * (low + high);
            change = fabs(next - u), u = next;
        }
        out[2 * m] = u, out[2 * m + 1] = rate;
    }
}
