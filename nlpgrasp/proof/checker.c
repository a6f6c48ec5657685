/* Checks that lower <= mu <= upper for a grasp and a task, from the proof on standard input alone. Format and argument:
   docs/proof_format.md. Intervals contain the real numbers: in() goes at least one floating-point number outwards.
   Build: cc -O2 -o checker checker.c -lm */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef struct { double lo, hi; } I;
typedef struct { int row, col; double x; } Entry; /* of a sparse matrix */

static void fail(const char *why, long at) { printf("NOT PROVED: %s (%ld)\n", why, at); exit(1); }
static I in(double lo, double hi) {
  I a = {lo - fabs(lo) * 0x1p-52 - 0x1p-1074, hi + fabs(hi) * 0x1p-52 + 0x1p-1074};
  if (!(a.hi - a.lo < INFINITY)) fail("numbers too large", 0);
  return a;
}
static I pt(double x) { return (I){x, x}; }
static int is_zero(I a) { return a.lo == 0 && a.hi == 0; }
static I add(I a, I b) { return is_zero(a) ? b : is_zero(b) ? a : in(a.lo + b.lo, a.hi + b.hi); }
static I mul(I a, I b) {
  double p = a.lo * b.lo, q = a.lo * b.hi, r = a.hi * b.lo, s = a.hi * b.hi;
  return is_zero(a) || is_zero(b) ? pt(0) : in(fmin(fmin(p, q), fmin(r, s)), fmax(fmax(p, q), fmax(r, s)));
}
static I dot(const I *a, const double *b, int m) {
  I s = pt(0);
  for (int i = 0; i < m; i++) s = add(s, mul(a[i], pt(b[i])));
  return s;
}
static I norm(const I *v, int m) {
  I s = pt(0);
  for (int i = 0; i < m; i++) {
    double most = fmax(fabs(v[i].lo), fabs(v[i].hi)), least = fmax(0, fmax(v[i].lo, -v[i].hi));
    s = add(s, (I){fmax(0, in(least * least, 0).lo), most > 0 ? in(0, most * most).hi : 0});
  }
  return is_zero(s) ? s : (I){fmax(0, in(sqrt(fmax(0, s.lo)), 0).lo), in(0, sqrt(s.hi)).hi};
}
static void expect(const char *name) { char w[32]; if (scanf("%31s", w) != 1 || strcmp(w, name)) fail(name, -1); }
static double number(void) { double x; if (scanf("%lf", &x) != 1 || !isfinite(x)) fail("no number", -1); return x; }
static int count(int least, int most) {
  double x = number();
  if (!(x >= least && x <= most) || x != floor(x)) fail("a count out of range", -1);
  return (int)x;
}
static int byte(void) { int c = getchar(); if (c == EOF) fail("the file ends", -1); return c; }
static void *room(size_t m, size_t size) { void *p = calloc(m + 1, size); if (!p) fail("no memory", 0); return p; }
static int matrix(Entry **out, int last_row, int last_col) {
  int m = count(0, 1 << 22); *out = room(m, sizeof **out);
  for (Entry *e = *out; e < *out + m; e++) { e->row = count(0, last_row); e->col = count(0, last_col); e->x = number(); }
  return m;
}
static void product(const Entry *e, int m, const double *u, I *out) {
  for (; m--; e++) out[e->row] = add(out[e->row], mul(pt(e->x), pt(u[e->col])));
}

static int d, at[6], n, U, cones, rows, first[(1 << 14) + 1], lifts, coned, parts, kind[64], many[64];
static Entry *lift, *cone;                           /* x = lift u, with cone (u, 1) in second-order cones */
static I G[4096][6], *work; static double *task[64]; /* wrenches of force components; rows of the task's parts */

static void used(const double *all, double *out) { /* the coordinates of wrench space that are used */
  for (int j = 0, q = 0; j < 6; j++) if (q < d && at[q] == j) out[q++] = all[j]; else if (all[j] != 0) fail("an unused coordinate", j);
}
static void wrench(double *out) { double all[6]; for (int j = 0; j < 6; j++) all[j] = number(); used(all, out); }
static int are_in_cones(const I *y) {
  for (int c = 0; c < cones; c++) if (!(y[first[c]].lo >= norm(y + first[c] + 1, first[c + 1] - first[c] - 1).hi)) return 0;
  return 1;
}
static I reach(const double *y) { /* the task's support along y */
  I s = pt(0);
  for (int t = 0; t < parts; t++) {
    I best = pt(-INFINITY);
    for (int i = 0; i < many[t]; i++) {
      work[i] = pt(0);
      for (int j = 0; j < d; j++) work[i] = add(work[i], mul(pt(task[t][i * d + j]), pt(y[j])));
      best = (I){fmax(best.lo, work[i].lo), fmax(best.hi, work[i].hi)};
    }
    s = add(s, kind[t] ? best : add(work[0], norm(work + 1, many[t] - 1)));
  }
  return s;
}
static void read_claim(void) {
  double o[3], e[3][3]; int most = 1;
  expect("nlpgrasp-proof"); count(1, 1);
  expect("coordinates"); d = count(2, 6); for (int j = 0; j < d; j++) at[j] = count(j ? at[j - 1] + 1 : 0, 5);
  expect("origin"); for (int j = 0; j < 3; j++) o[j] = number();
  expect("contacts");
  for (int k = count(1, 512); k--;) {
    I r[3], w[6];
    for (int j = 0; j < 3; j++) r[j] = add(pt(number()), pt(-o[j]));
    for (int j = 0; j < 9; j++) e[j / 3][j % 3] = number();
    for (int m = count(1, 6); m--; n++) { /* (2.3-6): a force along an axis of the frame, or a moment about one */
      int c = count(0, 5); const double *f = e[c % 3];
      for (int j = 0, a = 1, b = 2; j < 3; j++, a = (j + 1) % 3, b = (j + 2) % 3) {
        w[j] = pt(c < 3 ? f[j] : 0);
        w[3 + j] = c < 3 ? add(mul(r[a], pt(f[b])), mul(r[b], pt(-f[a]))) : pt(f[j]);
      }
      for (int j = 0, q = 0; j < 6; j++) if (q < d && at[q] == j) G[n][q++] = w[j]; else if (!is_zero(w[j])) fail("an unused coordinate", j);
    }
  }
  expect("variables"); U = count(1, 4096); expect("lift"); lifts = matrix(&lift, n - 1, U - 1);
  expect("cones"); cones = count(1, 1 << 14);
  for (int c = 0; c < cones; c++) { first[c] = rows; rows += count(1, 4096); }
  first[cones] = rows; coned = matrix(&cone, rows - 1, U);
  expect("task"); parts = count(1, 64);
  for (int t = 0; t < parts; t++) { /* 0: an ellipsoid, centre and semi-axes; 1: a polytope, its wrenches */
    kind[t] = count(0, 1); many[t] = count(1, 1 << 20); most = many[t] > most ? many[t] : most;
    task[t] = room((size_t)many[t] * d, sizeof(double));
    for (int i = 0; i < many[t]; i++) wrench(task[t] + i * d);
  }
  work = room(most, sizeof *work);
}
/* For multipliers s in the cones with b + M^T s = 0, b the work of unit variables along y, weak duality gives
   support(y) <= sum of s times the constants in M (u, 1). One row of each variable takes its multiplier from the equation. */
static void check_upper(double upper) {
  double y[6]; wrench(y);
  I *s = room(rows, sizeof *s), *b = room(U, sizeof *b), total = pt(0);
  char *pivot = room(rows, 1), *done = room(U, 1);
  for (int i = 0; i < rows; i++) s[i] = pt(number());
  for (int e = 0; e < lifts; e++) b[lift[e].col] = add(b[lift[e].col], mul(pt(lift[e].x), dot(G[lift[e].row], y, d)));
  for (int p = 0; p < U; p++) {
    int r = count(0, rows - 1), v = count(0, U - 1); double own = 0;
    if (pivot[r]++ || done[v]) fail("a pivot twice", p);
    for (const Entry *e = cone; e < cone + coned; e++) {
      if (e->row == r && e->col < U && done[e->col]) fail("pivots out of order", p);
      if (e->row == r && e->col == v && own == 0) own = e->x;
      else if (e->col == v) b[v] = add(b[v], mul(pt(e->x), s[e->row]));
    }
    if (own == 0) fail("a pivot of zero", p);
    done[v] = 1; s[r] = mul(b[v], in(-1 / own, -1 / own));
  }
  if (!are_in_cones(s)) fail("a multiplier is outside its cone", 0);
  for (int e = 0; e < coned; e++) if (cone[e].col == U) total = add(total, mul(pt(cone[e].x), s[cone[e].row]));
  if (!(total.hi <= mul(pt(upper), pt(fmax(0, reach(y).lo))).lo)) fail("the upper bound", 0);
}
static void inverse(double A[6][6], double B[6][6]) { /* Gauss-Jordan; nothing depends on its being exact */
  double M[6][12];
  for (int i = 0; i < d; i++) for (int j = 0; j < d; j++) { M[i][j] = A[i][j]; M[i][d + j] = i == j; }
  for (int c = 0; c < d; c++) {
    int p = c;
    for (int i = c; i < d; i++) if (fabs(M[i][c]) > fabs(M[p][c])) p = i;
    for (int j = 0; j < 2 * d; j++) { double t = M[c][j]; M[c][j] = M[p][j]; M[p][j] = t; }
    for (int i = 0; i < d; i++) {
      double f = M[i][c] / M[c][c];
      for (int j = c; j < 2 * d && i != c; j++) M[i][j] -= f * M[c][j];
    }
  }
  for (int i = 0; i < d; i++) for (int j = 0; j < d; j++) B[i][j] = M[i][d + j] / M[i][i];
}
static int order(const void *a, const void *b) { return memcmp(a, b, (d - 1) * sizeof(uint32_t)); }
static void check_lower(double lower) {
  double c[6], unit[6] = {0}, *u = room(U, sizeof *u); wrench(c); u[U] = 1;
  int V = count(d + 1, 1 << 20), C = count(d + 1, 1 << 24); byte();
  I(*v)[6] = room(V, sizeof *v), *x = room(n + rows, sizeof *x);
  for (int p = 0; p < V; p++) { /* 1. every vertex is a wrench of admissible forces */
    for (int i = 0; i < U; i++) {
      uint64_t bits = 0; for (int s = 0; s < 64; s += 8) bits |= (uint64_t)byte() << s;
      memcpy(u + i, &bits, 8); if (!isfinite(u[i])) fail("no number", p);
    }
    memset(x, 0, (n + rows) * sizeof *x); product(lift, lifts, u, x); product(cone, coned, u, x + n);
    if (!are_in_cones(x + n)) fail("forces of a vertex are not admissible", p);
    for (int j = 0; j < d; j++) {
      v[p][j] = pt(-c[j]); for (int i = 0; i < n; i++) v[p][j] = add(v[p][j], mul(G[i][j], x[i]));
      unit[j] = fmax(unit[j], fabs(v[p][j].hi));
    }
  }
  for (int j = 0; j < d; j++) { int e = 0; frexp(unit[j], &e); unit[j] = ldexp(1, -e); } /* for conditioning alone */
  uint32_t(*cell)[6] = room(C, sizeof *cell), *ridge = room((size_t)C * d * (d - 1), sizeof *ridge), *q = ridge;
  for (int t = 0; t < C; t++) { /* 2. the cells close: every ridge belongs to an even number of them */
    int same = t ? byte() : 0; if (same >= d) fail("a cell twice", t);
    memcpy(cell[t], cell[t ? t - 1 : 0], same * sizeof **cell);
    for (int i = same; i < d; i++) {
      uint64_t w = i ? (uint64_t)cell[t][i - 1] + 1 : 0;
      for (int s = 0, part = 128; part > 127 && s < 35; s += 7) { part = byte(); w += (uint64_t)(part & 127) << s; }
      if (w >= (uint64_t)V) fail("no such vertex", t);
      cell[t][i] = (uint32_t)w;
    }
    for (int i = 0; i < d; i++) for (int j = 0; j < d; j++) if (j != i) *q++ = cell[t][j];
  }
  qsort(ridge, (size_t)C * d, (d - 1) * sizeof *ridge, order);
  for (long i = 0; i < (long)C * d; i += 2)
    if (i + 1 == (long)C * d || order(ridge + i * (d - 1), ridge + (i + 1) * (d - 1))) fail("a ridge of an odd number of cells", i);
  I ray[6] = {{0, 0}}; for (int j = 0; j < d; j++) for (int i = 0; i < d; i++) ray[j] = add(ray[j], v[cell[0][i]][j]);
  for (int t = 0; t < C; t++) {
    double A[6][6], B[6][6], a[6] = {0}, z[6], h = INFINITY, least = INFINITY; int worst = 0;
    for (int i = 0; i < d; i++) for (int j = 0; j < d; j++) A[i][j] = unit[j] * 0.5 * (v[cell[t][i]][j].lo + v[cell[t][i]][j].hi);
    inverse(A, B);
    for (int j = 0; j < d; j++) for (int i = 0; i < d; i++) a[j] += B[j][i] *= unit[j];
    /* 3. the half-space <a, w - c> <= h cuts the cone of the cell inside the polytope, and holds the scaled task */
    for (int i = 0; i < d; i++) h = fmin(h, dot(v[cell[t][i]], a, d).lo);
    I off = pt(h); for (int j = 0; j < d; j++) off = add(off, mul(pt(a[j]), pt(c[j])));
    if (!(h > 0)) fail("a cell is not proved off the centre", t);
    if (!(mul(pt(lower), reach(a)).hi <= off.lo)) fail("the scaled task is not proved inside", t);
    /* 4. a ray through the first cell, which is solid, meets no other: the cells wind once around the centre */
    for (int i = 0; i < d && t == 0; i++) {
      double sum = 0;
      for (int j = 0; j < d; j++) {
        for (int l = 0; l < d; l++) z[l] = B[l][j];
        I entry = add(dot(v[cell[0][i]], z, d), pt(-(i == j))); sum += norm(&entry, 1).hi;
      }
      if (!(sum < 0.5)) fail("the first cell is not proved solid", i);
    }
    if (t == 0) continue;
    for (int i = 0; i < d; i++) {
      double along = 0;
      for (int j = 0; j < d; j++) along += B[j][i] * 0.5 * (ray[j].lo + ray[j].hi);
      if (along < least) { least = along; worst = i; }
    }
    double shift = 1e-3 * least / fmax(fabs(dot(ray, a, d).hi), 1e-300);
    for (int j = 0; j < d; j++) z[j] = B[j][worst] - shift * a[j];
    for (int i = 0; i < d; i++) if (!(dot(v[cell[t][i]], z, d).lo >= 0)) fail("the ray is not proved off a cell", t);
    if (!(dot(ray, z, d).hi < 0)) fail("the ray is not proved off a cell", t);
  }
}
int main(void) {
  read_claim();
  expect("bounds"); double lower = number(), upper = number(); if (!(0 <= lower && lower <= upper)) fail("bounds", -1);
  expect("upper"); check_upper(upper);
  expect("lower"); if (lower > 0) check_lower(lower);
  if (lower > 0 && getchar() != EOF) fail("more than a proof", -1);
  printf("PROVED: %.17g <= mu <= %.17g\n", lower, upper);
  return 0;
}
