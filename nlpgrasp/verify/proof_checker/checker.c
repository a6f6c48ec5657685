/* Checks that lower <= mu <= upper for a grasp and a task, from the proof on standard input alone. Format and argument:
   docs/proof_format.md. Intervals contain the real numbers: in() goes at least one floating-point number outwards.
   Build: cc -O2 -o checker checker.c -lm */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define EACH(i, m) for (int i = 0; i < (m); i++)
typedef struct { double lo, hi; } I;
typedef struct { int row, col; double x; } Entry; /* of a sparse matrix */
static void need(int holds, const char *step, long at) { if (!holds) { printf("NOT PROVED: %s (%ld)\n", step, at); exit(1); } }
static I in(double lo, double hi) {
  I a = {lo - fabs(lo) * 0x1p-52 - 0x1p-1074, hi + fabs(hi) * 0x1p-52 + 0x1p-1074};
  need(a.hi - a.lo < INFINITY, "numbers too large", 0);
  return a;
}
static I pt(double x) { return (I){x, x}; }
static int is_zero(I a) { return a.lo == 0 && a.hi == 0; }
static I add(I a, I b) { return is_zero(a) ? b : is_zero(b) ? a : in(a.lo + b.lo, a.hi + b.hi); }
static I mul(I a, I b) {
  double p = a.lo * b.lo, q = a.lo * b.hi, r = a.hi * b.lo, s = a.hi * b.hi;
  return is_zero(a) || is_zero(b) ? pt(0) : in(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s)));
}
static I dot(const I *a, const double *b, int m) { I s = pt(0); EACH(i, m) s = add(s, mul(a[i], pt(b[i]))); return s; }
static I norm(const I *v, int m) {
  I s = pt(0);
  EACH(i, m) {
    I size = {fmax(0, fmax(v[i].lo, -v[i].hi)), fmax(fabs(v[i].lo), fabs(v[i].hi))};
    s = add(s, mul(size, size));
  }
  return is_zero(s) ? s : in(sqrt(fmax(0, s.lo)), sqrt(s.hi));
}
static double number(void) { double x; need(scanf("%lf", &x) == 1 && isfinite(x), "a number is missing", -1); return x; }
static int count(int least, int most) {
  double x = number(); need(x >= least && x <= most && x == floor(x), "a count is out of range", -1);
  return (int)x;
}
static int byte(void) { int c = getchar(); need(c != EOF, "the file ends", -1); return c; }
static void word(const char *w) { char s[32]; need(scanf("%31s", s) == 1 && !strcmp(s, w), w, -1); }
static void *room(size_t m, size_t size) { void *p = calloc(m + 1, size); need(p != 0, "no memory", 0); return p; }
static int matrix(Entry **out, int last_row, int last_col) {
  int m = count(0, 1 << 22); *out = room(m, sizeof **out);
  EACH(i, m) { Entry *e = *out + i; e->row = count(0, last_row); e->col = count(0, last_col); e->x = number(); }
  return m;
}
static void product(const Entry *e, int m, const double *u, I *out) {
  EACH(i, m) out[e[i].row] = add(out[e[i].row], mul(pt(e[i].x), pt(u[e[i].col])));
}

static int d, at[6], n, U, cones, rows, first[16385], lifts, coned, parts, is_polytope[64], many[64];
static Entry *lift, *cone;                           /* x = lift u, with cone (u, 1) in second-order cones */
static I G[4096][6], *work; static double *task[64]; /* wrenches of force components; rows of the task's parts */
static void pick(const I *all, I *out) { /* the components of a wrench that are used */
  for (int j = 0, q = 0; j < 6; j++) if (q < d && at[q] == j) out[q++] = all[j]; else need(is_zero(all[j]), "an unused coordinate", j);
}
static void wrench(double *out) { I all[6], w[6]; EACH(j, 6) all[j] = pt(number()); pick(all, w); EACH(j, d) out[j] = w[j].lo; }
static int are_in_cones(const I *y) {
  EACH(c, cones) if (!(y[first[c]].lo >= norm(y + first[c] + 1, first[c + 1] - first[c] - 1).hi)) return 0;
  return 1;
}
static I reach(const double *y) { /* the task's support along y */
  I s = pt(0), v[6]; EACH(j, d) v[j] = pt(y[j]);
  EACH(t, parts) {
    I best = pt(-INFINITY);
    EACH(i, many[t]) { work[i] = dot(v, task[t] + i * d, d); best = (I){fmax(best.lo, work[i].lo), fmax(best.hi, work[i].hi)}; }
    s = add(s, is_polytope[t] ? best : add(work[0], norm(work + 1, many[t] - 1)));
  }
  return s;
}
static void read_claim(void) {
  double o[3], e[3][3]; int most = 1;
  word("nlpgrasp-proof"); count(1, 1); word("coordinates"); d = count(2, 6); EACH(j, d) at[j] = count(j ? at[j - 1] + 1 : 0, 5);
  word("origin"); EACH(j, 3) o[j] = number();
  word("contacts");
  for (int k = count(1, 512); k--;) {
    I r[3], w[6]; EACH(j, 3) r[j] = add(pt(number()), pt(-o[j])); EACH(j, 9) e[j / 3][j % 3] = number();
    for (int m = count(1, 6); m--; pick(w, G[n++])) { /* (2.3-6): a force along an axis of the frame, or a moment about one */
      int c = count(0, 5); const double *f = e[c % 3];
      EACH(j, 3) {
        int a = (j + 1) % 3, b = (j + 2) % 3; w[j] = pt(c < 3 ? f[j] : 0);
        w[3 + j] = c < 3 ? add(mul(r[a], pt(f[b])), mul(r[b], pt(-f[a]))) : pt(f[j]);
      }
    }
  }
  word("variables"); U = count(1, 4096); word("lift"); lifts = matrix(&lift, n - 1, U - 1);
  word("cones"); cones = count(1, 16384); EACH(c, cones) { first[c] = rows; rows += count(1, 4096); }
  first[cones] = rows; coned = matrix(&cone, rows - 1, U);
  word("task"); parts = count(1, 64);
  EACH(t, parts) { /* 0: an ellipsoid, centre and semi-axes; 1: a polytope, its wrenches */
    is_polytope[t] = count(0, 1); many[t] = count(1, 1 << 20); most = many[t] > most ? many[t] : most;
    task[t] = room((size_t)many[t] * d, sizeof(double)); EACH(i, many[t]) wrench(task[t] + i * d);
  }
  work = room(most, sizeof *work);
}
/* For multipliers s in the cones with b + M^T s = 0, b the work of unit variables along y, weak duality gives support(y)
   <= sum of s times the constants in M (u, 1). One row of each variable takes its multiplier from the equation. */
static void check_upper(double upper) {
  double y[6]; wrench(y); char *pivot = room(rows, 1), *done = room(U, 1);
  I *s = room(rows, sizeof *s), *b = room(U, sizeof *b), total = pt(0);
  EACH(i, rows) s[i] = pt(number());
  EACH(e, lifts) b[lift[e].col] = add(b[lift[e].col], mul(pt(lift[e].x), dot(G[lift[e].row], y, d)));
  EACH(p, U) {
    int r = count(0, rows - 1), v = count(0, U - 1); double own = 0;
    need(!pivot[r]++ && !done[v], "a pivot twice", p);
    for (const Entry *e = cone; e < cone + coned; e++) {
      need(e->row != r || e->col == U || !done[e->col], "pivots out of order", p);
      if (e->row == r && e->col == v) { need(own == 0, "a pivot of two entries", p); own = e->x; }
      else if (e->col == v) b[v] = add(b[v], mul(pt(e->x), s[e->row]));
    }
    need(own != 0, "a pivot of zero", p); done[v] = 1; s[r] = mul(b[v], in(-1 / own, -1 / own));
  }
  need(are_in_cones(s), "a multiplier is outside its cone", 0);
  EACH(e, coned) if (cone[e].col == U) total = add(total, mul(pt(cone[e].x), s[cone[e].row]));
  double least = reach(y).lo;
  need(least > 0 && total.hi <= mul(pt(upper), pt(least)).lo, "the upper bound", 0);
}
static void inverse(double M[6][12], double B[6][6]) { /* Gauss-Jordan; nothing depends on its being exact */
  EACH(c, d) {
    int p = c; for (int i = c; i < d; i++) if (fabs(M[i][c]) > fabs(M[p][c])) p = i;
    EACH(j, 2 * d) { double t = M[c][j]; M[c][j] = M[p][j]; M[p][j] = t; }
    EACH(i, d) { double f = M[i][c] / M[c][c]; for (int j = c; j < 2 * d && i != c; j++) M[i][j] -= f * M[c][j]; }
  }
  EACH(i, d) EACH(j, d) B[i][j] = M[i][d + j] / M[i][i];
}
static int order(const void *a, const void *b) { return memcmp(a, b, (d - 1) * sizeof(uint32_t)); }
static void check_lower(double lower) {
  double c[6], unit[6] = {0}, *u = room(U, sizeof *u); wrench(c); u[U] = 1;
  int V = count(d + 1, 1 << 20), C = count(d + 1, 1 << 24); byte();
  I(*v)[6] = room(V, sizeof *v), *x = room(n + rows, sizeof *x);
  EACH(p, V) { /* 1. every vertex is a wrench of admissible forces */
    EACH(i, U) { uint64_t w = 0; EACH(s, 8) w |= (uint64_t)byte() << 8 * s; memcpy(u + i, &w, 8); need(isfinite(u[i]), "a number is missing", p); }
    memset(x, 0, (n + rows) * sizeof *x); product(lift, lifts, u, x); product(cone, coned, u, x + n);
    need(are_in_cones(x + n), "forces of a vertex are not admissible", p);
    EACH(j, d) { v[p][j] = pt(-c[j]); EACH(i, n) v[p][j] = add(v[p][j], mul(G[i][j], x[i])); unit[j] = fmax(unit[j], fabs(v[p][j].hi)); }
  }
  EACH(j, d) { int e = 0; frexp(unit[j], &e); unit[j] = ldexp(1, -e); } /* for conditioning alone */
  uint32_t(*cell)[6] = room(C, sizeof *cell), *ridge = room((size_t)C * d * (d - 1), sizeof *ridge), *q = ridge;
  EACH(t, C) { /* 2. the cells close: every ridge belongs to an even number of them */
    int same = t ? byte() : 0; need(same < d, "a cell twice", t); memcpy(cell[t], cell[t ? t - 1 : 0], same * sizeof **cell);
    for (int i = same; i < d; i++) {
      uint64_t w = i ? (uint64_t)cell[t][i - 1] + 1 : 0;
      for (int s = 0, part = 128; part > 127 && s < 35; s += 7) { part = byte(); w += (uint64_t)(part & 127) << s; }
      need(w < (uint64_t)V, "no such vertex", t); cell[t][i] = (uint32_t)w;
    }
    EACH(i, d) EACH(j, d) if (j != i) *q++ = cell[t][j];
  }
  long ridges = (long)C * d; qsort(ridge, ridges, (d - 1) * sizeof *ridge, order);
  for (long i = 0; i < ridges; i += 2) need(i + 1 < ridges && !order(ridge + i * (d - 1), ridge + (i + 1) * (d - 1)), "a ridge of an odd number of cells", i);
  I ray[6] = {{0, 0}}; EACH(j, d) EACH(i, d) ray[j] = add(ray[j], v[cell[0][i]][j]);
  EACH(t, C) {
    double M[6][12] = {{0}}, B[6][6], a[6] = {0}, z[6], h = INFINITY, least = INFINITY; int worst = 0;
    EACH(i, d) { M[i][d + i] = 1; EACH(j, d) M[i][j] = unit[j] * 0.5 * (v[cell[t][i]][j].lo + v[cell[t][i]][j].hi); }
    inverse(M, B); EACH(j, d) EACH(i, d) a[j] += B[j][i] *= unit[j];
    /* 3. the half-space <a, w - c> <= h cuts the cone of the cell inside the polytope, and holds the scaled task */
    EACH(i, d) h = fmin(h, dot(v[cell[t][i]], a, d).lo);
    I off = pt(h); EACH(j, d) off = add(off, mul(pt(a[j]), pt(c[j])));
    need(h > 0 && mul(pt(lower), reach(a)).hi <= off.lo, "the scaled task is not proved inside a cell's half-space", t);
    EACH(i, d) { double along = 0; EACH(j, d) along += B[j][i] * 0.5 * (ray[j].lo + ray[j].hi); if (along < least) { least = along; worst = i; } }
    EACH(j, d) z[j] = B[j][worst] - 1e-3 * least / fmax(fabs(dot(ray, a, d).hi), 1e-300) * a[j];
    /* 4. a ray through the first cell, which is solid, meets no other: the cells wind once around the centre */
    EACH(i, d) need(t == 0 || dot(v[cell[t][i]], z, d).lo >= 0, "the ray is not proved off a cell", t);
    need(t == 0 || dot(ray, z, d).hi < 0, "the ray is not proved off a cell", t);
    EACH(i, t ? 0 : d) {
      I s = pt(0); EACH(j, d) { EACH(l, d) z[l] = B[l][j]; I one = add(dot(v[cell[0][i]], z, d), pt(-(i == j))); s = add(s, norm(&one, 1)); }
      need(s.hi < 1, "the first cell is not proved solid", i);
    }
  }
}
int main(void) {
  read_claim(); word("bounds"); double lower = number(), upper = number(); need(0 <= lower && lower <= upper, "bounds", -1);
  word("upper"); check_upper(upper);
  word("lower"); if (lower > 0) { check_lower(lower); need(getchar() == EOF, "more than a proof", -1); }
  printf("PROVED: %.17g <= mu <= %.17g\n", lower, upper);
  return 0;
}
