/* Motions with dry friction and end stops from one event to the next, as mechcore.dynamics.event_integrator has them with numpy: in
each phase some elements slide, some stick; windows of collocation are searched for what ends it, and with one freedom what follows
is decided here. Whatever is not (a stop on which something comes to rest, what several freedoms decide) is left to Python.

This stands after collocation.c, for programs whose additional outputs are, of ELEMENTS that rub, RESTS on stops and STOPPED joints
with stops: friction, its limits, relative rates and second rates of the elements (ELEMENTS each), what holds the rests (RESTS), whether
that is solved; accelerations without friction (F), the lower triangle of M; coordinates, rates and second rates at q'' = 0 of the
joints (STOPPED each). After the modes, m has the elements' signs, and whether they are about to break loose. */

#define SAMPLES 25 /* see dynamics.events: of a window */
#define GRID 100   /* of the polynomial through these */
#define POLISHED 12
#define MARK (8 + ELEMENTS)
#define BEGUN 1e-12 /* see dynamics.contact.friction_state */
#define LOOSE 1e-10
#define SOON_MOVED 1e-16
#define TOUCH 1e-11 /* see dynamics.contact.end_stops */
#define HELD 1e-11
#define LEAST_BOUNCE 1e-6

enum { ACCELERATION = F * (F + 1) / 2, VALUE = ACCELERATION + F + STATES, LIMIT = VALUE + ELEMENTS, RATE = LIMIT + ELEMENTS,
       SECOND = RATE + ELEMENTS, SOLVED = SECOND + ELEMENTS + RESTS, PLAIN = SOLVED + 1, MASS = PLAIN + F,
       COORDINATES = MASS + F * (F + 1) / 2, RATES = COORDINATES + STOPPED, SECONDS = RATES + STOPPED, OUTPUTS = SECONDS + STOPPED };
enum { NOTHING, SLIPS, STICKS, FREES, HITS }; /* kinds of what may end a phase: slip, sticking, rest of the only freedom, flight */

typedef struct {
    double joint, at, side, scale, restitution; /* which of the joints with stops; side 1: it stays above */
} Stop;

typedef struct {
    System y;
    double *m, *signs, *breaking;
    const double *scales; /* of the elements */
    const Stop *stops;
    long count; /* of the stops */
    double duration, soon, rest;
} Contacts;

typedef struct {
    long kind, index;
    double sense, noise, least;
} Event;

/* All outputs at a state, with the signs of the elements as they are in m. */
static void outputs(const Contacts *c, double t, const double *q, const double *v, double *out) {
    double d[GIVEN + 1], near[1] = {0.0};
    by_laws(&c->y, t, d);
    reduced(c->y.p, c->m, q, v, t, d, near, out);
}

/* Which way the elements slide where the only coordinate moves in a sense, and the acceleration in that sense at which it begins to
do so; not a number where friction is not found. Signs are left as they are, but for `signs` where that is wanted. */
static double freed(const Contacts *c, double t, const double *q, double sense, double *signs) {
    double kept[ELEMENTS + 1], out[OUTPUTS], v = sense;
    memcpy(kept, c->signs, ELEMENTS * sizeof(double));
    outputs(c, t, q, &v, out);
    for (long i = 0; i < ELEMENTS; i++) c->signs[i] = sign(out[RATE + i]);
    if (signs) memcpy(signs, c->signs, ELEMENTS * sizeof(double));
    v = sense * BEGUN;
    *c->breaking = 1.0;
    outputs(c, t, q, &v, out);
    *c->breaking = 0.0;
    memcpy(c->signs, kept, ELEMENTS * sizeof(double));
    return out[SOLVED] != 0.0 ? sense * out[ACCELERATION] : NAN;
}

/* How far a joint is from its stop, from the outputs at a state. */
static double gap(const Contacts *c, long stop, const double *out) {
    const Stop *own = c->stops + stop;
    return own->side * (out[COORDINATES + (long)own->joint] - own->at);
}

/* The measures of events at a state: each ends the phase where it rises above zero. */
static void measured(const Contacts *c, const Event *events, long count, double t, const double *q, const double *v, double *g) {
    double out[OUTPUTS];
    int known = 0;
    for (long k = 0; k < count; k++) {
        const Event *e = events + k;
        if (e->kind == FREES) {
            g[k] = freed(c, t, q, e->sense, 0);
            continue;
        }
        if (!known) outputs(c, t, q, v, out), known = 1;
        if (e->kind == SLIPS) g[k] = -e->sense * out[RATE + e->index];
        else if (e->kind == STICKS) g[k] = fabs(out[VALUE + e->index]) - out[LIMIT + e->index];
        else g[k] = e->least - gap(c, e->index, out);
    }
}

static double series_at(const double *c, double x) {
    double b = 0.0, last = 0.0;
    for (long j = SAMPLES - 1; j > 0; j--) {
        const double now = 2.0 * x * b - last + c[j];
        last = b, b = now;
    }
    return x * b - last + c[0];
}

/* A window, as `within` takes it. */
typedef struct {
    long s;
    const double *series, *q, *v;
    double t, h, after; /* slip ends later than that */
} Searched;

/* Where an event's measure is zero, from where its polynomial is: as events._polished. */
static double polished(const Contacts *c, const Event *event, const Searched *w, double x, double slope, double least) {
    double last = INFINITY, before_x = 0.0, before_y = 0.0, y;
    for (long k = 0; k < POLISHED; k++) {
        double q[F], v[F];
        within(w->s, F, w->series, w->h, 0.5 * (x + 1.0), w->q, w->v, q, v, 0);
        measured(c, event, 1, w->t + 0.5 * w->h * (x + 1.0), q, v, &y);
        if (k && x != before_x && y != before_y) {
            const double secant = (y - before_y) / (x - before_x);
            slope = secant * slope > 0.0 ? secant : slope;
        }
        if (slope == 0.0 || !isfinite(y)) return x;
        const double step = y / slope;
        if (!(fabs(step) < last)) return x;
        before_x = x, before_y = y, last = fabs(step), x -= step;
        if (last <= least) return x;
    }
    return x;
}

/* What is the same for all windows: the samples from -1 to 1, at last both ends, and the integrals of Legendre polynomials there, once
and twice; what makes coefficients of Chebyshev polynomials of values there, and their sums at places that are even in the angle. */
static struct {
    double x[SAMPLES + 2], once[SAMPLES + 2][MOST_NODES], twice[SAMPLES + 2][MOST_NODES], fit[SAMPLES][SAMPLES], grid[SAMPLES][GRID + 1];
} fixed;

__attribute__((constructor)) static void make_fixed(void) { /* when the library is loaded, before any thread calls it */
    const double half_turn = acos(-1.0);
    for (long k = 0; k < SAMPLES; k++) {
        const double angle = half_turn * ((double)(SAMPLES - 1 - k) + 0.5) / SAMPLES;
        fixed.x[k] = cos(angle);
        for (long j = 0; j < SAMPLES; j++) fixed.fit[j][k] = cos((double)j * angle) * (j ? 2.0 : 1.0) / SAMPLES;
    }
    for (long i = 0; i <= GRID; i++)
        for (long j = 0; j < SAMPLES; j++) {
            const double term = cos((double)j * half_turn * (double)(GRID - i) / GRID);
            for (long k = 0; k < SAMPLES; k++) fixed.grid[k][i] += term * fixed.fit[j][k];
        }
    fixed.x[SAMPLES] = -1.0, fixed.x[SAMPLES + 1] = 1.0;
    for (long i = 0; i < SAMPLES + 2; i++)
        for (long k = 0; k < MOST_NODES; k++) {
            const double none = 0.0;
            double series[MOST_NODES] = {0.0};
            series[k] = 1.0;
            within(k + 1, 1, series, 1.0, 0.5 * (fixed.x[i] + 1.0), &none, &none, fixed.twice[i] + k, fixed.once[i] + k, 0);
        }
}

/* The zero of a polynomial between angles of which it is negative at the first and positive at the second (false position). */
static double crossing(const double *series, double low, double high) {
    double below = series_at(series, -cos(low)), above = series_at(series, -cos(high)), at = high;
    for (long k = 0, side = 0; k < 60 && high - low > 1e-15 * high && above > below; k++) {
        at = (low * above - high * below) / (above - below);
        const double value = series_at(series, -cos(at));
        if (value == 0.0) break;
        if (value > 0.0) {
            high = at, above = value, below *= side > 0 ? 0.5 : 1.0, side = 1;
        } else {
            low = at, below = value, above *= side < 0 ? 0.5 : 1.0, side = -1;
        }
    }
    return at;
}

/* The first time in a window at which an event happens, by its measures y at the samples and at both ends; infinite where it
does not, not a number where a measure is none. As events.first_zero and events.first_exceeding. */
static double happens(const Contacts *c, const Event *event, const Searched *w, const double *y) {
    double most = fmax(y[SAMPLES], y[SAMPLES + 1]), least = fmin(y[SAMPLES], y[SAMPLES + 1]), way = 0.0, p[GRID + 1], series[SAMPLES];
    for (long k = 0; k < SAMPLES + 2; k++)
        if (!isfinite(y[k])) return NAN;
    for (long k = 0; k < SAMPLES; k++) {
        most = fmax(most, y[k]), least = fmin(least, y[k]);
        if (k) way += fabs(y[k] - y[k - 1]);
    }
    if ((most <= 0.0 && way < -y[0]) || (event->kind == SLIPS && ((least > 0.0 && way < y[0]) || (most == 0.0 && least == 0.0)))) return INFINITY;
    for (long j = 0; j < SAMPLES; j++) {
        series[j] = 0.0;
        for (long k = 0; k < SAMPLES; k++) series[j] += y[k] * fixed.fit[j][k];
    }
    const double apart = acos(-1.0) / GRID, last = fmax(fabs(w->t), fabs(w->t + w->h)), spacing = 4.0 * (nextafter(last, INFINITY) - last);
    for (long i = 0; i <= GRID; i++) p[i] = y[0] * fixed.grid[0][i];
    for (long k = 1; k < SAMPLES; k++) /* sample by sample: no term waits for the one before */
        for (long i = 0; i <= GRID; i++) p[i] += y[k] * fixed.grid[k][i];
    if (event->kind != SLIPS && p[0] > 0.0) { /* it has jumped above zero at the beginning */
        double highest = p[0];
        for (long i = 1; i <= GRID && p[i] > 0.0; i++) highest = fmax(highest, p[i]);
        if (highest > event->noise) return w->t + 2.0 * spacing;
    }
    for (long i = 0; i < GRID; i++) {
        double low = apart * (double)i, high = apart * (double)(i + 1);
        if (!(p[i] <= 0.0)) continue;
        if (!(p[i + 1] > 0.0)) {
            const double bend = i ? p[i - 1] - 2.0 * p[i] + p[i + 1] : 0.0; /* between places that are below zero it may be above it */
            if (!(i && p[i] >= p[i - 1] && p[i] >= p[i + 1] && bend < 0.0)) continue;
            high = low + apart * 0.5 * (p[i - 1] - p[i + 1]) / bend, low = apart * (double)(i - 1);
            if (!(series_at(series, -cos(high)) > 0.0)) continue;
        }
        double highest = series_at(series, -cos(high)), root = -cos(crossing(series, low, high));
        for (long k = i + 1; k <= GRID && p[k] > 0.0; k++) highest = fmax(highest, p[k]);
        if (event->kind != SLIPS && !(highest > event->noise)) continue;
        const double slope = (series_at(series, root + 1e-7) - series_at(series, root - 1e-7)) / 2e-7;
        root = polished(c, event, w, root, slope, spacing / w->h);
        if (event->kind == SLIPS && !(fabs(root) <= 1.0 + 1e-12 && w->t + 0.5 * w->h * (root + 1.0) > w->after)) continue;
        return w->t + fmax(0.5 * w->h * (fmin(root, 1.0) + 1.0), root <= -1.0 ? 2.0 * spacing : 0.0);
    }
    return INFINITY;
}

/* The event that happens first in a window, and when; -1 where none does, -2 where that is not known. */
static long first_event(const Contacts *c, const Event *events, long count, const Searched *w, double *when) {
    double g[count + 1], y[(count + 1) * (SAMPLES + 2)];
    long first = -1;
    *when = INFINITY;
    if (!count) return first;
    for (long i = 0; i < SAMPLES + 2; i++) {
        const double part = 0.5 * (fixed.x[i] + 1.0);
        double q[F], v[F];
        for (long k = 0; k < F; k++) {
            double once = 0.0, twice = 0.0;
            for (long j = 0; j < w->s; j++) once += w->series[j * F + k] * fixed.once[i][j], twice += w->series[j * F + k] * fixed.twice[i][j];
            q[k] = w->q[k] + w->h * part * w->v[k] + w->h * w->h * twice, v[k] = w->v[k] + w->h * once;
        }
        measured(c, events, count, w->t + w->h * part, q, v, g);
        for (long k = 0; k < count; k++) y[k * (SAMPLES + 2) + i] = g[k];
    }
    for (long k = 0; k < count; k++) {
        const double time = happens(c, events + k, w, y + k * (SAMPLES + 2));
        if (isnan(time)) return -2;
        if (time < *when) *when = time, first = k;
    }
    return first;
}

/* What may end a phase that begins at a state, from its outputs; their number. */
static long possible(const Contacts *c, double t, const double *q, const double *out, Event *events) {
    long count = 0;
    int stuck = ELEMENTS > 0;
    for (long i = 0; i < ELEMENTS; i++) stuck &= c->signs[i] == 0.0;
    if (stuck && F == 1 && DRIVES == 0) {
        const double noise = LOOSE * (fabs(freed(c, t, q, 1.0, 0)) + fabs(freed(c, t, q, -1.0, 0)));
        for (long k = 0; k < 2; k++) events[count++] = (Event){FREES, 0, k ? -1.0 : 1.0, noise, 0.0};
    } else
        for (long i = 0; i < ELEMENTS; i++) {
            if (c->signs[i] != 0.0) events[count++] = (Event){SLIPS, i, c->signs[i], 0.0, 0.0};
            else events[count++] = (Event){STICKS, i, 0.0, LOOSE * (out[LIMIT + i] + fabs(out[VALUE + i])), 0.0};
        }
    for (long k = 0; k < c->count; k++) events[count++] = (Event){HITS, k, 0.0, TOUCH * c->stops[k].scale, fmin(gap(c, k, out), 0.0)};
    return count;
}

/* Decide what slides and what sticks from now on, `loose` what has come loose; v is without what rounding has left of the rates of
what sticks. As friction_state.Phases. 0 where Python has to decide. */
static int decided(const Contacts *c, double t, const double *q, double *v, const Event *loose) {
    double out[OUTPUTS], rates[ELEMENTS + 1], before[ELEMENTS + 1], moved[ELEMENTS + 1], *signs = c->signs;
    int still[ELEMENTS + 1], any = 0, all = 1;
    const int alone = DRIVES == 0;
    if (!ELEMENTS) return 1;
    if (F != 1) return 0;
    memcpy(before, signs, ELEMENTS * sizeof(double));
    outputs(c, t, q, v, out);
    memcpy(rates, out + RATE, ELEMENTS * sizeof(double));
    double pace = fmax(fabs(v[0]) / c->y.scale[0], sqrt(fabs(out[PLAIN]) / c->y.scale[0]));
    for (long i = 0; i < ELEMENTS; i++) pace = fmax(pace, fabs(rates[i]) / c->scales[i]);
    const double least = fmax(c->rest * pace, SOON_MOVED / c->soon);
    if (!alone) {
        const double faster = v[0] + 1.0;
        outputs(c, t, q, &faster, out);
        for (long i = 0; i < ELEMENTS; i++) {
            moved[i] = out[RATE + i] - rates[i];
            if (moved[i] == 0.0) return 0; /* no force moves it */
        }
    }
    for (long i = 0; i < ELEMENTS; i++) {
        still[i] = fabs(rates[i]) <= least * c->scales[i];
        any |= still[i], all &= still[i];
        signs[i] = still[i] ? 0.0 : sign(rates[i]);
    }
    if (!any) return 1;
    if (alone && all && fabs(v[0]) <= least * c->y.scale[0]) {
        double directions[ELEMENTS + 1];
        if (loose) freed(c, t, q, loose->sense, directions);
        else {
            memset(directions, 0, ELEMENTS * sizeof(double));
            for (double sense = 1.0; sense >= -1.0; sense -= 2.0) {
                double own[ELEMENTS + 1];
                const double a = freed(c, t, q, sense, own);
                if (isnan(a)) return 0;
                if (a > 0.0) {
                    memcpy(directions, own, ELEMENTS * sizeof(double));
                    break;
                }
            }
        }
        memcpy(signs, directions, ELEMENTS * sizeof(double));
    } else if (alone) { /* what turns back while the mechanism moves does not stick */
        for (long i = 0; i < ELEMENTS; i++) signs[i] = still[i] ? before[i] == 0.0 ? 1.0 : before[i] : sign(rates[i]);
        outputs(c, t, q, v, out);
        if (out[SOLVED] == 0.0) return 0;
        for (long i = 0; i < ELEMENTS; i++)
            if (still[i] && out[SECOND + i] != 0.0) signs[i] = sign(out[SECOND + i]);
    } else {
        for (long round = loose && loose->kind == STICKS && still[loose->index] ? -1 : 0; round < 2 * ELEMENTS + 2; round++) {
            long worst = -1;
            double over = 0.0;
            outputs(c, t, q, v, out);
            if (out[SOLVED] == 0.0) return 0;
            if (round < 0) worst = loose->index;
            for (long i = 0; round >= 0 && i < ELEMENTS; i++)
                if (still[i] && signs[i] == 0.0 && fabs(out[VALUE + i]) > out[LIMIT + i] * (1.0 + 1e-12)) {
                    const double ratio = fabs(out[VALUE + i]) / fmax(out[LIMIT + i], 1e-300);
                    if (ratio > over) over = ratio, worst = i;
                }
            if (worst < 0) break;
            signs[worst] = -sign(out[VALUE + worst]);
            for (long i = 0; round < 0 && i < ELEMENTS; i++) /* what moves with it, and was at its limit, slides with it */
                if (still[i] && before[i] == signs[worst] && moved[i] == moved[worst] && rates[i] == rates[worst]) signs[i] = before[i];
        }
    }
    double above = 0.0, below = 0.0;
    for (long i = 0; i < ELEMENTS; i++)
        if (signs[i] == 0.0) {
            if (alone) v[0] = 0.0;
            else above += moved[i] * rates[i] / (c->scales[i] * c->scales[i]), below += moved[i] * moved[i] / (c->scales[i] * c->scales[i]);
        }
    if (below > 0.0) v[0] -= above / below;
    return 1;
}

/* `decided` by itself: signs and v at a state, `loose` the kind of what has come loose (0: nothing), its index and sense. */
long settled_at(const System *y, const double *numbers, long modes, double *given, double t, const double *q, double *v, const double *loose) {
    double m[modes + ELEMENTS + 1];
    Contacts c = {*y, m, m + modes, m + modes + ELEMENTS, given, 0, 0, numbers[0], numbers[1], numbers[2]};
    const Event event = {(long)loose[0], (long)loose[1], loose[2], 0.0, 0.0};
    memcpy(m, y->m, (size_t)modes * sizeof(double));
    memcpy(c.signs, given + ELEMENTS, ELEMENTS * sizeof(double));
    *c.breaking = 0.0;
    c.y.m = m;
    const int found = decided(&c, t, q, v, loose[0] != 0.0 ? &event : 0);
    memcpy(given + ELEMENTS, c.signs, ELEMENTS * sizeof(double));
    return found;
}

/* A joint of the only freedom hits a stop and comes back, by Newton's law: v after it, `told` the energy that is lost and the speed at
which it hits. 0 where Python has to decide. */
static int bounced(const Contacts *c, long stop, double t, const double *q, double *v, double *told) {
    double out[OUTPUTS];
    const Stop *own = c->stops + stop;
    const double e = own->restitution;
    if (F != 1 || DRIVES != 0 || e == 0.0) return 0;
    outputs(c, t, q, v, out);
    const double rate = own->side * out[RATES + (long)own->joint], arm = rate / v[0];
    if (!(-rate > 1e3 * TOUCH * (own->scale / c->duration - rate)) || !(fabs(arm) * c->y.scale[0] / own->scale > 1e3 * HELD)) return 0;
    told[0] = 0.5 * (1.0 - e * e) * out[MASS] * v[0] * v[0];
    told[1] = -rate;
    v[0] *= -e;
    if (!decided(c, t, q, v, 0)) return 0;
    outputs(c, t, q, v, out);
    if (ELEMENTS && out[SOLVED] == 0.0) return 0;
    const double second = arm * out[ACCELERATION] + own->side * out[SECONDS + (long)own->joint];
    return !(-2.0 * e * rate < -second * LEAST_BOUNCE * c->duration); /* else it would come back at once */
}

/* Where an integration begins at t, q, v of `at`: the length of its first window, its guess. 0 where there are no accelerations. */
static int begun(const Contacts *c, const Rule *r, double end, double starts, double *at, double *out) {
    double *q = at + HEAD, *v = q + F, *end_a = v + F, *guess = end_a + F, speed = 0.0, change = 0.0;
    outputs(c, at[0], q, v, out);
    for (long i = 0; i < F; i++) {
        end_a[i] = out[ACCELERATION + i];
        if (!isfinite(end_a[i])) return 0;
        speed = fmax(speed, fabs(v[i]) / c->y.scale[i]), change = fmax(change, fabs(end_a[i]) / c->y.scale[i]);
        for (long k = 0; k < r->s; k++) guess[k * F + i] = end_a[i];
    }
    at[1] = end - at[0];
    if (speed > 0.0) at[1] = fmin(at[1], 0.2 / speed);
    if (change > 0.0) at[1] = fmin(at[1], sqrt(0.2 / change));
    at[2] = at[6] = at[7] = at[8] = at[9] = 0.0;
    at[5] = starts;
    return !(ELEMENTS && out[SOLVED] == 0.0);
}

/* Phases one after the other from where `at` says on, see `windows`, `count` windows in all at the most, `limit` phases.

`numbers`: end, least, most, tolerance and small as of `windows`; duration, what is soon, what is at rest, strain from which other
coordinates had better lead, places of the first coordinate between which it has to be. `modes`, `stops`: how many there are; `given`: scales of the elements, their signs at present, the stops.
`out` has the windows, `marks` of each phase: where it begins and ends, how many windows there are until then, the kind, index and sense
of what ends it (0: nothing; negative: it is not decided what follows), energy lost in an impact and its speed; signs. The result is
the number of phases; `at` tells where they have ended, `given` which signs hold there. */
long phases(const System *y, const Rule *r, const double *numbers, long modes, long stops, double *given, long count, long limit,
            long checked, const double *breaks, double *at, double *out, double *marks) {
    const long s = r->s, size = 4 + 2 * F + s * F;
    const double end = numbers[0], least = numbers[1];
    double m[modes + ELEMENTS + 2], state[OUTPUTS], when;
    Contacts c = {*y, m, m + modes, m + modes + ELEMENTS, given, (const Stop *)(given + 2 * ELEMENTS), stops, numbers[5], numbers[6], numbers[7]};
    memcpy(m, y->m, (size_t)modes * sizeof(double));
    memcpy(c.signs, given + ELEMENTS, ELEMENTS * sizeof(double));
    *c.breaking = 0.0;
    c.y.m = m;
    double *q = at + HEAD, *v = q + F, *now = given + ELEMENTS;
    long made = 0, done = 0, bouncing = -1;
    while (done < limit) {
        Event events[ELEMENTS + stops + 2];
        double *mark = marks + done * MARK;
        const double start = at[0];
        const long before = made;
        if (!begun(&c, r, end, (double)(checked || isfinite(*breaks)), at, state)) return done;
        for (long k = 0; done && k < stops; k++) /* what touches another stop at an event is for Python */
            if (k != bouncing && fabs(gap(&c, k, state)) <= TOUCH * c.stops[k].scale) return done;
        const long possibilities = possible(&c, start, q, state, events);
        long first = -1;
        int goes_on = 1;
        while (first < 0 && goes_on && made < count && at[0] < end - least) {
            double *window = out + made * size;
            goes_on = windows(&c.y, r, end, least, numbers[2], numbers[3], numbers[4], 1, checked, breaks, at, window) == 1;
            if (goes_on) {
                const Searched whole = {s, window + 4 + 2 * F, window + 4, window + 4 + F, window[0], window[1], start + 1e-12 * c.duration};
                int fine = window[2] <= numbers[8] && q[0] > numbers[9] && q[0] < numbers[10];
                for (long k = 0; fine && k < SAMPLES; k++) {
                    double place = window[4] + window[1] * 0.5 * (fixed.x[k] + 1.0) * window[4 + F];
                    for (long j = 0; j < s; j++) place += window[1] * window[1] * window[4 + 2 * F + j * F] * fixed.twice[k][j];
                    fine = place > numbers[9] && place < numbers[10];
                }
                first = fine ? first_event(&c, events, possibilities, &whole, &when) : -2;
                if (first == -2) { /* it is not known, other coordinates had better lead, or a singular point is near */
                    at[0] = window[0], goes_on = 0, first = -1;
                    memcpy(q, window + 4, 2 * F * sizeof(double));
                } else made++;
            }
        }
        memset(mark, 0, 8 * sizeof(double));
        memcpy(mark + 8, c.signs, ELEMENTS * sizeof(double));
        mark[0] = start, mark[1] = first < 0 ? at[0] : when, mark[2] = (double)made;
        if (first < 0) return done + (made > before);
        const Event *event = events + first;
        const double *window = out + (made - 1) * size;
        within(s, F, window + 4 + 2 * F, window[1], (when - window[0]) / window[1], window + 4, window + 4 + F, q, v, 0);
        at[0] = when;
        mark[3] = (double)event->kind, mark[4] = (double)event->index, mark[5] = event->sense;
        done++;
        double after[F], told[2] = {0.0, 0.0};
        memcpy(after, v, F * sizeof(double));
        bouncing = event->kind == HITS ? event->index : -1;
        if (!(event->kind == HITS ? bounced(&c, event->index, when, q, after, told) : decided(&c, when, q, after, event->kind == SLIPS ? 0 : event))) {
            mark[3] = -mark[3];
            return done;
        }
        memcpy(v, after, F * sizeof(double));
        memcpy(now, c.signs, ELEMENTS * sizeof(double));
        mark[6] = told[0], mark[7] = told[1];
        if (when >= end - least) return done;
    }
    return done;
}
