/* A simulator of somebody else's for `fcu`: C11, libc and libm, nothing of this project.
 *
 *     cc -std=c11 -O2 -Wall -Wextra -o plant plant.c -lm
 *     ./plant --instance 0 --vehicle quad.txt --wind turn --wind-max 8
 *
 * Simulation time stands until a line on standard input moves it: README.md lists the lines.
 * North-East-Down and Forward-Right-Down everywhere.
 */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define PI 3.14159265358979323846
#define G 9.81
#define ROTORS 8
#define FLAT 3.0 /* m about the start */
#define CUT 0.35 /* of the weight: rotors that push with less carry nothing */
#define CLEAR_S 0.5 /* without a contact: what hops on the ground is not in the air */

enum { WRONG_USE = 2, LINK_FAILED = 3 };

static void fail(int code, const char *form, ...) {
    va_list list;
    va_start(list, form);
    fputs("plant: ", stderr);
    vfprintf(stderr, form, list);
    fputc('\n', stderr);
    va_end(list);
    exit(code);
}

/* ---- vectors ---- */

typedef struct { double x, y, z; } vec;

static vec v3(double x, double y, double z) { return (vec){x, y, z}; }
static vec add(vec a, vec b) { return v3(a.x + b.x, a.y + b.y, a.z + b.z); }
static vec sub(vec a, vec b) { return v3(a.x - b.x, a.y - b.y, a.z - b.z); }
static vec scale(double k, vec a) { return v3(k * a.x, k * a.y, k * a.z); }
static double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static double norm(vec a) { return sqrt(dot(a, a)); }
static vec cross(vec a, vec b) {
    return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static vec shorter(vec a, double most) {
    double n = norm(a);
    return n > most ? scale(most / n, a) : a;
}

typedef struct { double w, x, y, z; } quat;

static vec to_earth(quat q, vec a) {
    vec u = v3(q.x, q.y, q.z), t = scale(2.0, cross(u, a));
    return add(a, add(scale(q.w, t), cross(u, t)));
}
static vec to_body(quat q, vec a) { return to_earth((quat){q.w, -q.x, -q.y, -q.z}, a); }
static quat turned(quat q, vec rate, double dt) { /* exact for a rate that stands */
    double n = norm(rate), half = 0.5 * n * dt, k = n > 1e-12 ? sin(half) / n : 0.5 * dt, c = cos(half);
    vec d = scale(k, rate);
    quat p = {q.w * c - q.x * d.x - q.y * d.y - q.z * d.z, q.x * c + q.w * d.x + q.y * d.z - q.z * d.y,
              q.y * c + q.w * d.y + q.z * d.x - q.x * d.z, q.z * c + q.w * d.z + q.x * d.y - q.y * d.x};
    double m = 1.0 / sqrt(p.w * p.w + p.x * p.x + p.y * p.y + p.z * p.z);
    return (quat){p.w * m, p.x * m, p.y * m, p.z * m};
}

/* ---- random numbers: splitmix64 ---- */

static uint64_t seed_state;
static uint64_t bits(void) {
    uint64_t z = (seed_state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}
static double uniform(void) { return (double)(bits() >> 11) * 0x1p-53; }
static double normal(void) { return sqrt(-2.0 * log(1.0 - uniform())) * cos(2.0 * PI * uniform()); }

/* ---- options and the vehicle ---- */

static struct {
    int rotors;
    double forward[ROTORS], right[ROTORS], spin[ROTORS], coefficient[ROTORS], full[ROTORS];
    double mass, lag, torque_to_thrust, rotor_inertia, spin_up, mass_first;
    double thrust_min, thrust_max, tilt_max;
    vec inertia, drag;
    double gear, foot, stiffness, damping, friction, impact_max;
} body = {.mass = 8.0, .lag = 0.05, .torque_to_thrust = 0.016, .spin_up = 1.0, .thrust_max = 1e9, .tilt_max = 45.0,
          .gear = 0.2, .friction = 0.8, .impact_max = 3.0};

static struct {
    int instance;
    double rate, timeout, wind_max, wind_rate, period, axis, arena, drop_at, drop_ratio, slope;
    int up;
    const char *vehicle, *wind, *switches, *series;
    uint64_t seed;
    vec steady;
    double start_z;
} given = {.rate = 500.0, .timeout = 5.0, .wind_rate = 20.0, .period = 4.0, .arena = 300.0,
           .wind = "steady", .drop_at = -1.0, .drop_ratio = 1.0};

static double number(const char *text, const char *what) {
    char *end;
    double x = strtod(text, &end);
    if (end == text || *end || !isfinite(x)) fail(WRONG_USE, "%s: a number is expected, not '%s'", what, text);
    return x;
}

static vec three(const char *text, const char *what) {
    vec a;
    char rest;
    if (sscanf(text, "%lf,%lf,%lf%c", &a.x, &a.y, &a.z, &rest) != 3)
        fail(WRONG_USE, "%s: north,east,down is expected, not '%s'", what, text);
    return a;
}

static void read_vehicle(const char *path) {
    FILE *file = fopen(path, "r");
    if (!file) fail(WRONG_USE, "cannot read the vehicle %s: %s", path, strerror(errno));
    char line[256];
    for (int n = 1; fgets(line, sizeof line, file); n++) {
        char key[32];
        double a[5] = {0};
        int k = sscanf(line, "%31s %lf %lf %lf %lf %lf", key, a, a + 1, a + 2, a + 3, a + 4) - 1;
        if (k < 0 || *key == '#') continue;
        struct { const char *key; int count; double *to; } table[] = {
            {"mass", 1, &body.mass}, {"lag", 1, &body.lag}, {"torque_to_thrust", 1, &body.torque_to_thrust},
            {"rotor_inertia", 1, &body.rotor_inertia}, {"thrust_min", 1, &body.thrust_min},
            {"spin_up", 1, &body.spin_up}, /* 0: a rotor that speeds up turns nothing */
            {"thrust_max", 1, &body.thrust_max}, {"tilt_max", 1, &body.tilt_max}, {"gear", 1, &body.gear},
            {"inertia", 3, &body.inertia.x}, {"drag", 3, &body.drag.x}, {"impact_max", 1, &body.impact_max},
        };
        bool found = false;
        for (size_t i = 0; i < sizeof table / sizeof *table; i++)
            if (!strcmp(key, table[i].key) && k == table[i].count) {
                memcpy(table[i].to, a, (size_t)k * sizeof *a);
                found = true;
            }
        if (!strcmp(key, "rotor") && k == 5 && body.rotors < ROTORS) {
            int i = body.rotors++;
            body.forward[i] = a[0], body.right[i] = -a[1], body.spin[i] = a[2];
            body.coefficient[i] = a[3], body.full[i] = a[4];
            found = true;
        }
        if (!found) fail(WRONG_USE, "%s:%d: not understood: %s", path, n, line);
    }
    fclose(file);
    if (body.rotors < 4) fail(WRONG_USE, "%s: %d rotors, at least 4 are expected", path, body.rotors);
    for (int i = 0; i < body.rotors; i++)
        body.foot = fmax(body.foot, 0.6 * hypot(body.forward[i], body.right[i]));
    body.stiffness = body.mass * G / 4.0 / 0.01; /* sinks in by 1 cm */
    body.damping = 1.4 * sqrt(body.stiffness * body.mass / 4.0);
}

/* ---- the state ---- */

static struct {
    vec at, velocity, rate, wind, thrust_command;
    quat q;
    double speed[ROTORS], command[ROTORS];
    bool touching;
    double touch_speed;
} now = {.q = {1.0, 0.0, 0.0, 0.0}};

static uint64_t tick;
static bool dropped;
static double seconds(void) { return (double)tick / given.rate; }

/* ---- the air ---- */

static double switch_at[4096];
static int switches;

static void read_switches(const char *path) {
    FILE *file = fopen(path, "r");
    if (!file) fail(WRONG_USE, "cannot read the switching times %s: %s", path, strerror(errno));
    while (switches < 4096 && fscanf(file, "%lf", &switch_at[switches]) == 1) switches++;
    fclose(file);
    if (!switches) fail(WRONG_USE, "%s: no switching time in it", path);
}

static struct { double t; vec w; } series[4096];
static int samples;

static void read_series(const char *path) {
    FILE *file = fopen(path, "r");
    if (!file) fail(WRONG_USE, "cannot read the samples of wind %s: %s", path, strerror(errno));
    double t, n, e, d;
    while (samples < 4096 && fscanf(file, "%lf %lf %lf %lf", &t, &n, &e, &d) == 4) {
        if (samples && t <= series[samples - 1].t) fail(WRONG_USE, "%s: line %d: time does not go on", path, samples + 1);
        series[samples].t = t, series[samples++].w = v3(n, e, d);
    }
    bool whole = feof(file);
    fclose(file);
    if (!whole || samples < 2) fail(WRONG_USE, "%s: line %d is no sample, T N E D; two are needed, and 4096 are taken", path, samples + 1);
}

/* the samples from the first to the last, again and again, turned by the axis; between them it runs straight */
static vec of_series(double t) {
    double first = series[0].t, a = given.axis * PI / 180.0;
    t = first + fmod(t, series[samples - 1].t - first);
    int k = 1;
    while (k < samples - 1 && series[k].t <= t) k++;
    double part = (t - series[k - 1].t) / (series[k].t - series[k - 1].t);
    vec w = add(scale(1.0 - part, series[k - 1].w), scale(part, series[k].w));
    return v3(cos(a) * w.x - sin(a) * w.y, sin(a) * w.x + cos(a) * w.y, w.z);
}

static vec gust, held;

static vec wanted_wind(double t, double dt) {
    double W = given.wind_max, phase = 2.0 * PI * t / given.period, a = given.axis * PI / 180.0;
    vec along = given.up ? v3(0.0, 0.0, -1.0) : v3(cos(a), sin(a), 0.0);
    const char *kind = given.wind;
    if (!strcmp(kind, "steady")) return given.steady;
    if (!strcmp(kind, "sine")) return add(given.steady, scale(W * sin(phase), along));
    if (!strcmp(kind, "turn")) return scale(W, v3(cos(phase + a), sin(phase + a), 0.0));
    if (!strcmp(kind, "gust")) {
        double keep = exp(-dt / given.period), kick = W / 3.0 * sqrt(1.0 - keep * keep);
        gust = add(scale(keep, gust), scale(kick, v3(normal(), normal(), given.up ? normal() : 0.0)));
        return add(given.steady, gust);
    }
    if (!strcmp(kind, "series")) return of_series(t);
    if (!strcmp(kind, "bang")) {
        int passed = 0;
        if (switches) while (passed < switches && switch_at[passed] <= t) passed++;
        else passed = (int)floor(2.0 * t / given.period);
        return scale(passed % 2 ? -W : W, along);
    }
    /* those that answer: a new direction once the vehicle moves or leans clearly */
    vec of = !strcmp(kind, "against-velocity") || !strcmp(kind, "with-velocity") ? now.velocity : now.thrust_command;
    bool with = !strncmp(kind, "with-", 5);
    double least = of.x == now.velocity.x && of.y == now.velocity.y ? 0.05 : 0.02 * body.mass;
    if (!given.up) of.z = 0.0;
    if (norm(of) > least) held = scale((with ? W : -W) / norm(of), of);
    return held;
}

static void blow(double dt) {
    vec step = sub(shorter(wanted_wind(seconds(), dt), given.wind_max), now.wind);
    now.wind = shorter(add(now.wind, shorter(step, given.wind_rate * dt)), given.wind_max);
}

/* ---- forces and motion ---- */

/* Height of the ground: flat about the start, then up (or down) a slope on all sides. */
static double ground(vec at) {
    return tan(given.slope * PI / 180.0) * fmax(0.0, hypot(at.x, at.y) - FLAT);
}

/* The unit vector that points out of it. */
static vec away(vec at) {
    double far = hypot(at.x, at.y), k = far > FLAT ? tan(given.slope * PI / 180.0) / far : 0.0;
    vec n = v3(-k * at.x, -k * at.y, -1.0);
    return scale(1.0 / norm(n), n);
}

static void move(double dt) {
    double thrust = 0.0, spin_up = 0.0, momentum = 0.0;
    vec torque = {0};
    for (int i = 0; i < body.rotors; i++) {
        double before = now.speed[i], to = now.command[i] * body.full[i];
        now.speed[i] = to + (before - to) * exp(-dt / body.lag);
        double T = body.coefficient[i] * now.speed[i] * now.speed[i];
        thrust += T;
        torque.x -= body.right[i] * T;
        torque.y += body.forward[i] * T;
        torque.z += body.spin[i] * body.torque_to_thrust * T;
        spin_up += body.spin[i] * body.rotor_inertia * (now.speed[i] - before) / dt;
        momentum -= body.spin[i] * body.rotor_inertia * now.speed[i];
    }
    torque.z += body.spin_up * spin_up;
    vec air = to_body(now.q, sub(now.velocity, now.wind));
    double v = norm(air);
    vec force = to_earth(now.q, v3(-body.drag.x * v * air.x, -body.drag.y * v * air.y, -thrust - body.drag.z * v * air.z));
    force.z += body.mass * G;
    bool touching = false;
    vec normal = away(now.at);
    double up = -normal.z;
    for (int i = 0; i < 4; i++) {
        vec arm = v3(i & 1 ? body.foot : -body.foot, i & 2 ? body.foot : -body.foot, body.gear);
        vec at = add(now.at, to_earth(now.q, arm));
        vec moves = add(now.velocity, to_earth(now.q, cross(now.rate, arm)));
        double depth = up * (at.z + ground(at)); /* a vehicle that stands at the start is at -gear + 1 cm */
        if (depth <= 0.0) continue;
        touching = true;
        double into = -dot(moves, normal), press = fmax(0.0, body.stiffness * depth + body.damping * into);
        vec along = add(moves, scale(into, normal));
        double slide = norm(along), grip = body.friction * press * slide / (slide + 0.05) / fmax(slide, 1e-9);
        vec push = sub(scale(press, normal), scale(grip, along));
        force = add(force, push);
        torque = add(torque, cross(arm, to_body(now.q, push)));
    }
    if (touching && !now.touching) now.touch_speed = norm(now.velocity);
    now.touching = touching;
    vec H = v3(body.inertia.x * now.rate.x, body.inertia.y * now.rate.y, body.inertia.z * now.rate.z + momentum);
    torque = sub(torque, cross(now.rate, H));
    vec before = now.velocity;
    now.velocity = add(now.velocity, scale(dt / body.mass, force));
    now.at = add(now.at, scale(0.5 * dt, add(before, now.velocity)));
    now.rate = add(now.rate, scale(dt, v3(torque.x / body.inertia.x, torque.y / body.inertia.y, torque.z / body.inertia.z)));
    now.q = turned(now.q, now.rate, dt);
}

/* ---- the verdict, by the truth ---- */

static struct {
    uint64_t air, rotor, but_yaw, thrust, tilt, resent, strange;
    uint64_t since_ground; /* ticks without a contact */
    uint64_t rotor_run, rotor_longest; /* ticks in a row with a rotor at a limit */
    double tilt_most, thrust_most, thrust_least, off_most, wind_most, wind_rate_most, speed_most;
    double touchdown, arrived, goal_since;
    double touched_at, disarmed, cut_high; /* s, s after it, m: with next to no thrust in the air, once it lands */
    int contacts;
    char lost[32];
    bool flew, landing, has_goal, arrived_yet;
    vec goal;
    double within;
} judged = {.thrust_least = 1e9, .touchdown = -1.0, .touched_at = -1.0, .disarmed = -1.0};

static void judge(vec wind_before, double dt) {
    static bool was_touching = true;
    double level = now.q.w * now.q.w - now.q.x * now.q.x - now.q.y * now.q.y + now.q.z * now.q.z;
    double tilt = acos(fmin(1.0, fmax(-1.0, level))) * 180.0 / PI;
    /* roll and pitch each, as the limit is said to be of each */
    double pitch = fabs(asin(fmin(1.0, fmax(-1.0, 2.0 * (now.q.w * now.q.y - now.q.z * now.q.x))))) * 180.0 / PI;
    double roll = fabs(atan2(2.0 * (now.q.w * now.q.x + now.q.y * now.q.z), 1.0 - 2.0 * (now.q.x * now.q.x + now.q.y * now.q.y))) * 180.0 / PI;
    double thrust = 0.0, told = 0.0, yaw = 0.0, each[ROTORS], full[ROTORS];
    bool pinned = false, but_yaw = false;
    for (int i = 0; i < body.rotors; i++) {
        thrust += body.coefficient[i] * now.speed[i] * now.speed[i];
        full[i] = body.coefficient[i] * body.full[i] * body.full[i];
        each[i] = full[i] * now.command[i] * now.command[i];
        yaw += body.spin[i] * each[i] / body.rotors;
        told += each[i];
    }
    for (int i = 0; i < body.rotors; i++) { /* at a limit, and there too with its share of yaw's torque left out */
        bool most = now.command[i] >= 1.0 - 1e-6, least = now.command[i] <= 1e-6;
        double rest = each[i] - body.spin[i] * yaw;
        pinned |= most || least;
        but_yaw |= (most && rest >= 0.999 * full[i]) || (least && rest <= 0.001 * full[i]);
    }
    double high = -now.at.z - ground(now.at) - body.gear;
    if (!now.touching && high > 0.1) judged.flew = true;
    if (now.touching && judged.flew && judged.touched_at < 0.0) judged.touched_at = seconds();
    if (judged.touched_at >= 0.0 && told > 0.0) judged.disarmed = seconds() - judged.touched_at;
    if (now.touching && !was_touching) judged.contacts++, judged.touchdown = now.touch_speed;
    was_touching = now.touching;
    judged.wind_most = fmax(judged.wind_most, norm(now.wind));
    judged.wind_rate_most = fmax(judged.wind_rate_most, norm(sub(now.wind, wind_before)) / dt);
    judged.since_ground = now.touching ? 0 : judged.since_ground + 1;
    if (judged.flew && (double)judged.since_ground >= CLEAR_S * given.rate) {
        judged.air++;
        judged.touched_at = judged.disarmed = -1.0;
        if (judged.landing && told < CUT * body.mass * G) judged.cut_high = fmax(judged.cut_high, high);
        judged.rotor += pinned;
        judged.but_yaw += but_yaw;
        judged.rotor_run = pinned ? judged.rotor_run + 1 : 0;
        if (judged.rotor_run > judged.rotor_longest) judged.rotor_longest = judged.rotor_run;
        judged.thrust += thrust >= body.thrust_max || thrust <= body.thrust_min;
        judged.tilt += roll >= body.tilt_max || pitch >= body.tilt_max;
        judged.tilt_most = fmax(judged.tilt_most, fmax(roll, pitch));
        judged.thrust_most = fmax(judged.thrust_most, thrust);
        judged.thrust_least = fmin(judged.thrust_least, thrust);
        judged.speed_most = fmax(judged.speed_most, norm(now.velocity));
    }
    const char *lost = "";
    if (!isfinite(norm(now.at)) || !isfinite(norm(now.rate))) lost = "not_finite";
    else if (tilt > 85.0) lost = "tipped";
    else if (norm(now.at) > given.arena) lost = "away";
    else if (now.touching && now.touch_speed > body.impact_max) lost = "impact";
    if (*lost && !*judged.lost) snprintf(judged.lost, sizeof judged.lost, "%s", lost);
    if (judged.has_goal) {
        double off = norm(sub(now.at, judged.goal));
        if (off <= judged.within && !judged.arrived_yet) judged.arrived_yet = true, judged.arrived = seconds() - judged.goal_since;
        if (judged.arrived_yet) judged.off_most = fmax(judged.off_most, off);
    }
}

static void say_state(void) {
    printf("{\"t\": %.6f, \"at\": [%.6f, %.6f, %.6f], \"velocity\": [%.6f, %.6f, %.6f], \"q\": [%.9f, %.9f, %.9f, %.9f], "
           "\"wind\": [%.4f, %.4f, %.4f], \"touching\": %s, \"high\": %.4f, \"spinning\": %s, \"lost\": \"%s\", \"at_limit\": [%llu, %llu, %llu], \"but_yaw\": %llu, \"longest_s\": %.3f, \"arrived_s\": ",
           seconds(), now.at.x, now.at.y, now.at.z, now.velocity.x, now.velocity.y, now.velocity.z, now.q.w, now.q.x, now.q.y,
           now.q.z, now.wind.x, now.wind.y, now.wind.z, now.touching ? "true" : "false",
           -now.at.z - ground(now.at) - body.gear,
           now.command[0] > 0.0 ? "true" : "false", judged.lost, (unsigned long long)judged.rotor,
           (unsigned long long)judged.thrust, (unsigned long long)judged.tilt, (unsigned long long)judged.but_yaw, (double)judged.rotor_longest / given.rate);
    judged.rotor_longest = 0; /* of the time since the last line */
    if (judged.arrived_yet) printf("%.3f, \"off_most_m\": %.4f}\n", judged.arrived, judged.off_most);
    else printf("null, \"off_most_m\": null}\n");
    fflush(stdout);
}

static void say_verdict(void) {
    double n = judged.air ? (double)judged.air : 1.0;
    printf("{\"t\": %.6f, \"flew\": %s, \"air_s\": %.3f, \"rotor_at_limit_fraction\": %.6f, \"thrust_at_limit_fraction\": %.6f, "
           "\"tilt_at_limit_fraction\": %.6f, \"tilt_most_deg\": %.3f, \"thrust_most_n\": %.3f, \"thrust_least_n\": %.3f, "
           "\"speed_most_m_s\": %.3f, \"wind_most_m_s\": %.3f, \"wind_rate_most_m_s2\": %.3f, \"contacts\": %d, "
           "\"touchdown_m_s\": ",
           seconds(), judged.flew ? "true" : "false", (double)judged.air / given.rate, (double)judged.rotor / n,
           (double)judged.thrust / n, (double)judged.tilt / n, judged.tilt_most, judged.thrust_most,
           judged.air ? judged.thrust_least : 0.0, judged.speed_most, judged.wind_most, judged.wind_rate_most, judged.contacts);
    if (judged.touchdown >= 0.0) printf("%.4f", judged.touchdown); else printf("null");
    if (judged.disarmed >= 0.0) printf(", \"disarmed_s\": %.3f", judged.disarmed);
    else printf(", \"disarmed_s\": null");
    printf(", \"cut_m\": %.4f, \"lost\": \"%s\", \"states_sent_again\": %llu, \"strange_datagrams\": %llu}\n", judged.cut_high, judged.lost,
           (unsigned long long)judged.resent, (unsigned long long)judged.strange);
    fflush(stdout);
}

/* ---- MAVLink 2 ---- */

static uint16_t crc(uint16_t c, uint8_t byte) {
    uint8_t t = byte ^ (uint8_t)c;
    t ^= (uint8_t)(t << 4);
    return (uint16_t)((c >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4));
}

static uint8_t sequence;

static size_t frame(uint8_t *to, uint32_t message, uint8_t extra, const uint8_t *payload, size_t length) {
    while (length > 1 && !payload[length - 1]) length--; /* MAVLink 2 leaves zeros at the end out */
    uint8_t head[10] = {0xFD, (uint8_t)length, 0, 0, sequence++, (uint8_t)(given.instance + 1), 1,
                        (uint8_t)message, (uint8_t)(message >> 8), (uint8_t)(message >> 16)};
    memcpy(to, head, 10);
    memcpy(to + 10, payload, length);
    uint16_t c = 0xFFFF;
    for (size_t i = 1; i < 10 + length; i++) c = crc(c, to[i]);
    c = crc(c, extra);
    to[10 + length] = (uint8_t)c, to[11 + length] = (uint8_t)(c >> 8);
    return 12 + length;
}

/* Numbers are little-endian on the wire, and on every machine that this is compiled for. */
static uint8_t *put(uint8_t *to, const void *from, size_t size) { memcpy(to, from, size); return to + size; }
static uint8_t *put_float(uint8_t *to, double x) { float f = (float)x; return put(to, &f, 4); }

static int plant_socket;
static struct sockaddr_in controller;

static void send_state(bool standing) {
    uint8_t datagram[800], payload[256], *p;
    size_t n = 0;
    uint64_t us = (uint64_t)llround(seconds() * 1e6);
    if (standing) {
        uint32_t mode = *judged.lost ? (strcmp(judged.lost, "away") ? 2 : 1) : 0;
        p = put(payload, &mode, 4);
        uint8_t rest[5] = {0, 8, 0, *judged.lost ? 6 : 4, 3};
        p = put(p, rest, 5);
        n += frame(datagram + n, 0, 50, payload, (size_t)(p - payload));
    }
    double sign = now.q.w < 0.0 ? -1.0 : 1.0;
    vec v = to_body(now.q, now.velocity);
    p = put(payload, &us, 8);
    double numbers[] = {now.at.x, now.at.y, now.at.z, sign * now.q.w, sign * now.q.x, sign * now.q.y, sign * now.q.z,
                        v.x, v.y, v.z, now.rate.x, now.rate.y, now.rate.z};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) p = put_float(p, numbers[i]);
    for (int i = 0; i < 42; i++) p = put_float(p, i % 21 ? 0.0 : (double)NAN);
    uint8_t frames[5] = {1, 12, 0, 0, 0};
    p = put(p, frames, 5);
    n += frame(datagram + n, 331, 91, payload, (size_t)(p - payload));
    uint32_t active = (1u << body.rotors) - 1u;
    p = put(put(payload, &us, 8), &active, 4);
    for (int i = 0; i < 32; i++) p = put_float(p, i < body.rotors ? body.spin[i] * now.speed[i] : 0.0);
    n += frame(datagram + n, 375, 251, payload, (size_t)(p - payload));
    if (tick % (uint64_t)fmax(1.0, round(given.rate / 10.0)) == 0) {
        uint8_t battery[54] = {0};
        int32_t used = (int32_t)(seconds() * 10.0), energy = (int32_t)(seconds() * 8.0);
        uint16_t millivolt[10];
        for (int i = 0; i < 10; i++) millivolt[i] = i ? 0xFFFF : 24000;
        int16_t current = 3000;
        memcpy(battery, &used, 4), memcpy(battery + 4, &energy, 4), memcpy(battery + 10, millivolt, 20);
        memcpy(battery + 30, &current, 2);
        battery[35] = 90;
        n += frame(datagram + n, 147, 154, battery, sizeof battery);
    }
    /* a controller that is not there yet, or no longer, is found out by its silence */
    (void)!sendto(plant_socket, datagram, n, 0, (struct sockaddr *)&controller, sizeof controller);
}

static bool take_answer(const uint8_t *d, size_t n) {
    if (n < 12 || d[0] != 0xFD || n != 12u + d[1] || d[2] || d[5] != given.instance + 1 || d[6] != 1) return false;
    if (d[7] != 93 || d[8] || d[9] || d[1] > 81) return false;
    uint16_t c = 0xFFFF;
    for (size_t i = 1; i < 10u + d[1]; i++) c = crc(c, d[i]);
    c = crc(c, 47);
    if ((uint8_t)c != d[10 + d[1]] || (uint8_t)(c >> 8) != d[11 + d[1]]) return false;
    uint8_t payload[81] = {0};
    memcpy(payload, d + 10, d[1]);
    uint64_t us;
    memcpy(&us, payload, 8);
    if (us != (uint64_t)llround(seconds() * 1e6)) return false;
    float u[ROTORS];
    memcpy(u, payload + 16, sizeof u);
    for (int i = 0; i < body.rotors; i++)
        if (!(u[i] >= 0.0f && u[i] <= 1.0f)) return false;
    double thrust = 0.0;
    for (int i = 0; i < body.rotors; i++) {
        now.command[i] = (double)u[i];
        double w = now.command[i] * body.full[i];
        thrust += body.coefficient[i] * w * w;
    }
    now.thrust_command = to_earth(now.q, v3(0.0, 0.0, -thrust));
    return true;
}

/* Return whether a datagram asks for the start again: COMMAND_LONG, PREFLIGHT_REBOOT_SHUTDOWN, 1. */
static bool asks_for_reset(const uint8_t *d, size_t n) {
    if (n < 42 || d[0] != 0xFD || n != 12u + d[1] || d[7] != 76 || d[8] || d[9]) return false;
    uint16_t c = 0xFFFF, command;
    for (size_t i = 1; i < 10u + d[1]; i++) c = crc(c, d[i]);
    c = crc(c, 152);
    float what;
    memcpy(&what, d + 10, 4), memcpy(&command, d + 38, 2);
    return (uint8_t)c == d[10 + d[1]] && (uint8_t)(c >> 8) == d[11 + d[1]] && command == 246 && what == 1.0f;
}

static void reset(void) {
    now.at = v3(0.0, 0.0, -body.gear + 0.01);
    now.velocity = now.rate = now.wind = now.thrust_command = gust = v3(0.0, 0.0, 0.0);
    held = scale(given.wind_max, v3(cos(given.axis * PI / 180.0), sin(given.axis * PI / 180.0), 0.0));
    now.q = (quat){1.0, 0.0, 0.0, 0.0};
    memset(now.speed, 0, sizeof now.speed);
    memset(now.command, 0, sizeof now.command);
    now.touching = true;
    now.touch_speed = 0.0;
    tick = 0;
    seed_state = given.seed;
    judged.lost[0] = 0;
    judged.has_goal = judged.landing = false;
    if (body.mass_first > 0.0) body.mass = body.mass_first;
    dropped = false;
    uint8_t payload[3] = {246, 0, 0}, datagram[32]; /* COMMAND_ACK: accepted */
    size_t n = frame(datagram, 77, 143, payload, sizeof payload);
    (void)!sendto(plant_socket, datagram, n, 0, (struct sockaddr *)&controller, sizeof controller);
}

static double clock_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void fly_a_tick(void) {
    double since = clock_s();
    send_state(false);
    for (bool answered = false; !answered;) {
        struct pollfd wait = {.fd = plant_socket, .events = POLLIN};
        if (poll(&wait, 1, 100) == 0) {
            if (clock_s() - since > given.timeout)
                fail(LINK_FAILED, "no answer to the state of %.0f us for %.1f s", seconds() * 1e6, given.timeout);
            judged.resent++;
            send_state(false);
            continue;
        }
        uint8_t datagram[2048];
        struct sockaddr_in from;
        socklen_t size = sizeof from;
        ssize_t n = recvfrom(plant_socket, datagram, sizeof datagram, 0, (struct sockaddr *)&from, &size);
        if (n < 0) continue; /* the controller's port is closed: its silence will be found out */
        answered = from.sin_port == controller.sin_port && take_answer(datagram, (size_t)n);
        judged.strange += !answered;
    }
    const int steps = 4;
    double dt = 1.0 / given.rate;
    vec before = now.wind;
    blow(dt);
    for (int i = 0; i < steps; i++) move(dt / steps);
    tick++;
    if (given.drop_at >= 0.0 && !dropped && seconds() >= given.drop_at) {
        body.mass_first = body.mass;
        body.mass *= given.drop_ratio;
        dropped = true;
    }
    judge(before, dt);
}

/* ---- lines ---- */

static void obey(char *line) {
    double a[4];
    if (sscanf(line, "until %lf", a) == 1) {
        uint64_t last = (uint64_t)llround(a[0] * given.rate);
        while (tick < last && !*judged.lost) fly_a_tick();
        say_state();
    } else if (sscanf(line, "goal %lf %lf %lf %lf", a, a + 1, a + 2, a + 3) == 4) {
        judged.has_goal = true, judged.arrived_yet = false, judged.off_most = 0.0;
        judged.goal = v3(a[0], a[1], a[2]), judged.within = a[3], judged.goal_since = seconds();
    } else if (!strcmp(line, "no goal")) {
        judged.has_goal = false;
    } else if (!strcmp(line, "landing")) {
        judged.landing = true;
    } else if (!strcmp(line, "end")) {
        say_verdict();
        exit(0);
    } else {
        fail(WRONG_USE, "the line is not understood: %s", line);
    }
}

int main(int count, char **words) {
    for (int i = 1; i < count; i += 2) {
        const char *key = words[i], *value = i + 1 < count ? words[i + 1] : NULL;
        if (!value) fail(WRONG_USE, "%s has no value", key);
        struct { const char *key; double *to; } numbers[] = {
            {"--rate", &given.rate}, {"--timeout", &given.timeout}, {"--wind-max", &given.wind_max},
            {"--wind-rate", &given.wind_rate}, {"--wind-period", &given.period}, {"--wind-axis", &given.axis},
            {"--arena", &given.arena}, {"--ground-slope", &given.slope}, {"--mass-change-at", &given.drop_at}, {"--mass-ratio", &given.drop_ratio},
        };
        bool found = true;
        if (!strcmp(key, "--vehicle")) given.vehicle = value;
        else if (!strcmp(key, "--wind")) given.wind = value;
        else if (!strcmp(key, "--wind-steady")) given.steady = three(value, key);
        else if (!strcmp(key, "--wind-switches")) given.switches = value;
        else if (!strcmp(key, "--wind-series")) given.series = value;
        else if (!strcmp(key, "--wind-vertical")) given.up = number(value, key) != 0.0;
        else if (!strcmp(key, "--seed")) given.seed = strtoull(value, NULL, 10);
        else if (!strcmp(key, "--instance")) given.instance = (int)number(value, key);
        else {
            found = false;
            for (size_t k = 0; k < sizeof numbers / sizeof *numbers; k++)
                if (!strcmp(key, numbers[k].key)) *numbers[k].to = number(value, key), found = true;
        }
        if (!found) fail(WRONG_USE, "no option %s; README.md lists them", key);
    }
    if (!given.vehicle) fail(WRONG_USE, "--vehicle FILE is needed");
    if (given.instance < 0 || given.instance > 9) fail(WRONG_USE, "--instance is 0 to 9, not %d", given.instance);
    static const char *kinds[] = {"steady", "sine", "turn", "gust", "bang", "series", "against-velocity",
                                  "with-velocity", "against-thrust", "with-thrust"};
    bool known = false;
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) known |= !strcmp(given.wind, kinds[k]);
    if (!known) fail(WRONG_USE, "no wind '%s'; README.md lists them", given.wind);
    if (given.wind_max < norm(given.steady)) given.wind_max = norm(given.steady);
    seed_state = given.seed;
    read_vehicle(given.vehicle);
    if (given.switches) read_switches(given.switches);
    if (given.series) read_series(given.series);
    if (!strcmp(given.wind, "series") && !samples) fail(WRONG_USE, "--wind series needs --wind-series FILE");
    held = scale(given.wind_max, v3(cos(given.axis * PI / 180.0), sin(given.axis * PI / 180.0), 0.0));
    now.at.z = -body.gear + 0.01;

    plant_socket = socket(AF_INET, SOCK_DGRAM, 0);
    struct sockaddr_in own = {.sin_family = AF_INET, .sin_port = htons((uint16_t)(4560 + given.instance)),
                              .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    controller = own;
    controller.sin_port = htons((uint16_t)(4660 + given.instance));
    if (bind(plant_socket, (struct sockaddr *)&own, sizeof own))
        fail(LINK_FAILED, "cannot open port %d: %s", 4560 + given.instance, strerror(errno));
    char line[256];
    size_t have = 0;
    for (;;) { /* simulation time stands here */
        struct pollfd wait = {.fd = 0, .events = POLLIN};
        if (poll(&wait, 1, 5) <= 0) {
            uint8_t datagram[2048];
            ssize_t n;
            while ((n = recv(plant_socket, datagram, sizeof datagram, MSG_DONTWAIT)) >= 0) {
                if (asks_for_reset(datagram, (size_t)n)) reset();
                else judged.strange++;
            }
            send_state(true);
            continue;
        }
        ssize_t n = read(0, line + have, sizeof line - 1 - have);
        if (n <= 0) say_verdict(), exit(0);
        have += (size_t)n, line[have] = 0;
        for (char *end; (end = strchr(line, '\n'));) {
            *end = 0;
            obey(line);
            memmove(line, end + 1, have - (size_t)(end + 1 - line) + 1);
            have = strlen(line);
        }
    }
}
