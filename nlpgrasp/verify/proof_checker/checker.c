/* Checks that lower <= mu <= upper for a grasp and a task, from the proof on standard input alone. Format and argument:
   docs/proof_format.md. Intervals contain the real numbers: in() goes at least one floating-point number outwards.
   Build, where doubles are little-endian: cc -O3 -o checker checker.c -lm */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define EACH(i, m) for (int i = 0; i < (m); i++)
/* calls of fmin and fmax would take a third of the time; what is not finite, in() refuses */
static double low(double a, double b) { return a < b ? a : b; }
static double high(double a, double b) { return a > b ? a : b; }
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
  return is_zero(a) || is_zero(b) ? pt(0) : in(low(low(p, q), low(r, s)), high(high(p, q), high(r, s)));
}
static I times(I a, double b) { return b == 0 || is_zero(a) ? pt(0) : b > 0 ? in(a.lo * b, a.hi * b) : in(a.hi * b, a.lo * b); }
static I dot(const I *a, const double *b, int m) { I s = pt(0); EACH(i, m) s = add(s, times(a[i], b[i])); return s; }
static I root(I a) { return is_zero(a) ? a : in(sqrt(high(0, a.lo)), sqrt(a.hi)); }
static const char *text(void) { /* the next word, of printable characters alone */
  static char s[400]; int c, m = 0;
  do c = getchar(); while (c == ' ' || c == '\n' || c == '\t' || c == '\r');
  for (; c > ' ' && c < 127 && m < 399; c = getchar()) s[m++] = (char)c;
  s[m] = 0; need(c == EOF || c == ' ' || c == '\n' || c == '\t' || c == '\r', "a word that is no text", -1);
  ungetc(c, stdin); return s;
}
static double number(void) { /* decimal: strtod alone would read hexadecimal too */
  const char *s = text(); char *end; double x = strspn(s, "+-.0123456789eE") == strlen(s) ? strtod(s, &end) : NAN;
  need(isfinite(x) && end != s && !*end, "a number is missing", -1); return x;
}
static int count(int least, int most) {
  double x = number(); need(x >= least && x <= most && x == floor(x), "a count is out of range", -1); return (int)x;
}
static void word(const char *w) { need(!strcmp(text(), w), w, -1); }
static void *room(size_t m, size_t size) { void *p = calloc(m + 1, size); need(p != 0, "no memory", 0); return p; }
static int matrix(Entry **out, int last_row, int last_col) {
  int m = count(0, 1 << 22); *out = room(m, sizeof **out);
  EACH(i, m) { Entry *e = *out + i; e->row = count(0, last_row); e->col = count(0, last_col); e->x = number(); } return m;
}
static void product(const Entry *e, int m, const double *u, I *out) {
  EACH(i, m) out[e[i].row] = add(out[e[i].row], mul(pt(e[i].x), pt(u[e[i].col])));
}

static int d, used[6], n, owner[4096], U, cones, rows, first[16385], lifts, coned, parts, is_polytope[64], many[64];
static Entry *lift, *cone;                           /* x = lift u, with cone (u, 1) in second-order cones */
static I G[4096][6]; static double *task[64]; /* wrenches of force components; rows of the task's parts */
static void pick(const I *all, I *out) { /* the components of a wrench that are used */
  for (int j = 0, q = 0; j < 6; j++) if (q < d && used[q] == j) out[q++] = all[j]; else need(is_zero(all[j]), "an unused coordinate", j);
}
static void wrench(double *out) { I all[6], w[6]; EACH(j, 6) all[j] = pt(number()); pick(all, w); EACH(j, d) out[j] = w[j].lo; }
static int outside(const I *y) { /* the first block that is not in its cone, or -1 */
  EACH(c, cones) {
    I squares = pt(0); for (int i = first[c] + 1; i < first[c + 1]; i++) squares = add(squares, mul(y[i], y[i]));
    if (y[first[c]].lo < root(squares).hi) return c;
  }
  return -1;
}
static void need_forces(int c, int vertex) { /* block c of a vertex, if it is not -1, is the budget's or a contact's */
  int contact = -1, is_budget = 0;
  EACH(e, coned) if (c >= 0 && cone[e].row >= first[c] && cone[e].row < first[c + 1]) {
    is_budget |= cone[e].col == U; EACH(i, lifts) if (lift[i].col == cone[e].col) contact = owner[lift[i].row];
  }
  if (c >= 0 && !is_budget) printf("NOT PROVED: forces of vertex %d are outside the cone of contact %d\n", vertex, contact);
  if (c >= 0 && is_budget) printf("NOT PROVED: forces of vertex %d are beyond their budget\n", vertex);
  if (c >= 0) exit(1);
}
static I reach(const double *y) { /* the task's support along y */
  I s = pt(0), v[6]; EACH(j, d) v[j] = pt(y[j]);
  EACH(t, parts) {
    I most = dot(v, task[t], d), squares = pt(0);
    for (int i = 1; i < many[t]; i++) {
      I w = dot(v, task[t] + i * d, d);
      if (is_polytope[t]) most = (I){high(most.lo, w.lo), high(most.hi, w.hi)}; else squares = add(squares, mul(w, w));
    }
    s = add(s, add(most, root(squares)));
  }
  return s;
}
static void read_claim(void) {
  double o[3], e[3][3];
  word("nlpgrasp-proof"); count(1, 1); word("coordinates"); d = count(2, 6); EACH(j, d) used[j] = count(j ? used[j - 1] + 1 : 0, 5);
  word("origin"); EACH(j, 3) o[j] = number();
  word("contacts");
  int contacts = count(1, 512);
  EACH(k, contacts) {
    I r[3], w[6]; EACH(j, 3) r[j] = add(pt(number()), pt(-o[j])); EACH(j, 9) e[j / 3][j % 3] = number();
    for (int m = count(1, 6); m--; owner[n] = k, pick(w, G[n++])) { /* (2.3-6): a force along an axis of the frame, or a moment about one */
      int c = count(0, 5); const double *f = e[c % 3];
      EACH(j, 3) w[j] = pt(c < 3 ? f[j] : 0);
      EACH(j, 3) w[3 + j] = c < 3 ? add(mul(r[(j + 1) % 3], pt(f[(j + 2) % 3])), mul(r[(j + 2) % 3], pt(-f[(j + 1) % 3]))) : pt(f[j]);
    }
  }
  word("variables"); U = count(1, 4096); word("lift"); lifts = matrix(&lift, n - 1, U - 1);
  word("cones"); cones = count(1, 16384); EACH(c, cones) { first[c] = rows; rows += count(1, 4096); }
  first[cones] = rows; coned = matrix(&cone, rows - 1, U);
  word("task"); parts = count(1, 64);
  EACH(t, parts) { /* 0: an ellipsoid, centre and semi-axes; 1: a polytope, its wrenches */
    is_polytope[t] = count(0, 1); many[t] = count(1, 1 << 20);
    task[t] = room((size_t)many[t] * d, sizeof(double)); EACH(i, many[t]) wrench(task[t] + i * d);
  }
}
/* For multipliers s in the cones with b + M^T s = 0, b the work of unit variables along y, weak duality gives support(y)
   <= sum of s times the constants in M (u, 1). One row of each variable takes its multiplier from the equation. */
static void check_upper(double upper) {
  double y[6]; wrench(y); char *done = room(U, 1);
  I *s = room(rows, sizeof *s), *b = room(U, sizeof *b), total = pt(0);
  EACH(i, rows) s[i] = pt(number());
  EACH(e, lifts) b[lift[e].col] = add(b[lift[e].col], mul(pt(lift[e].x), dot(G[lift[e].row], y, d)));
  EACH(p, U) {
    int r = count(0, rows - 1), v = count(0, U - 1); double own = 0;
    for (const Entry *e = cone; e < cone + coned; e++) {
      need(e->row != r || e->col == U || !done[e->col], "pivots out of order", p);
      if (e->row == r && e->col == v) { need(own == 0, "a pivot of two entries", p); own = e->x; }
      else if (e->col == v) b[v] = add(b[v], mul(pt(e->x), s[e->row]));
    }
    need(own != 0, "a pivot of zero", p); done[v] = 1; s[r] = mul(b[v], in(-1 / own, -1 / own));
  }
  int c = outside(s); need(c < 0, "a multiplier is outside its cone", c);
  EACH(e, coned) if (cone[e].col == U) total = add(total, mul(pt(cone[e].x), s[cone[e].row]));
  need(reach(y).lo > 0 && total.hi <= mul(pt(upper), reach(y)).lo, "the upper bound", 0);
}
static double (*x)[6]; static I (*v)[6]; /* vertices relative to the centre, and intervals that contain them */
static struct { int at[6]; double a[6], h; } cell[1 << 22]; /* vertices, ascending, with <a, v> >= h > 0 at each */
static int cells, ridge[1 << 17][6], met[1 << 17], place[1 << 17], table[1 << 18]; /* ridges, and a hash table of them */
static void join(const int *border, int p) { /* a ridge and a later vertex to a cell, and <a, v> about 1 by Gauss-Jordan */
  int *at = cell[cells].at; memcpy(at, border, sizeof *ridge); at[d - 1] = p;
  double M[6][7], *a = cell[cells].a, h = INFINITY; EACH(i, d) { memcpy(M[i], x[at[i]], sizeof *x); M[i][d] = 1; }
  EACH(c, d) {
    int q = c; for (int i = c; i < d; i++) if (fabs(M[i][c]) > fabs(M[q][c])) q = i;
    EACH(j, d + 1) { double t = M[c][j]; M[c][j] = M[q][j]; M[q][j] = t; }
    EACH(i, d) { double f = M[i][c] / M[c][c]; for (int j = c; j <= d && i != c; j++) M[i][j] -= f * M[c][j]; }
  }
  EACH(j, d) a[j] = M[j][d] / M[j][j];
  EACH(i, d) h = low(h, dot(v[at[i]], a, d).lo);
  need(h > 0, "a cell is not proved off the centre", p); cell[cells++].h = h; need(cells < 1 << 22, "too many cells", p);
}
static void check_lower(double lower) {
  int V = count(d + 1, 1 << 20), e[6]; need(getchar() == '\n', "no line feed", -1); x = room(V, sizeof *x); v = room(V, sizeof *v);
  double *u = room(U, sizeof *u); u[U] = 1; I *y = room(n + rows, sizeof *y), c[6] = {{0, 0}};
  EACH(p, V) { /* 1. every vertex is a wrench of admissible forces; the centre is the mean of the first d + 1 */
    need(fread(u, 8, U, stdin) == (size_t)U, "the file ends", p); EACH(i, U) need(isfinite(u[i]), "no number", p);
    memset(y, 0, (n + rows) * sizeof *y); product(lift, lifts, u, y); product(cone, coned, u, y + n);
    need_forces(outside(y + n), p);
    EACH(j, d) { EACH(i, n) v[p][j] = add(v[p][j], mul(G[i][j], y[i])); if (p <= d) c[j] = add(c[j], v[p][j]); }
  }
  EACH(j, d) c[j] = mul(c[j], in(1.0 / (d + 1), 1.0 / (d + 1)));
  EACH(p, V) EACH(j, d) { v[p][j] = add(v[p][j], (I){-c[j].hi, -c[j].lo}); x[p][j] = 0.5 * (v[p][j].lo + v[p][j].hi); }
  EACH(i, d + 1) { EACH(j, d) e[j] = j + (j >= i); join(e, e[d - 1]); } /* 2. cells: those of a simplex around the centre; */
  for (int p = d + 1; p < V; p++) { /* those that see another vertex give way to its cone over their border */
    int m = 0;
    for (int t = cells; t--;) {
      double height = 0; EACH(j, d) height += cell[t].a[j] * x[p][j];
      if (height <= 1 + 1e-9 || dot(v[p], cell[t].a, d).lo <= 0) continue;
      need(m + d <= 1 << 17, "too many cells", p);
      EACH(i, d) {
        unsigned at = 0; EACH(j, d - 1) at = (at ^ (ridge[m][j] = cell[t].at[j + (j >= i)])) * 2654435761u;
        for (at >>= 14; table[at] && memcmp(ridge[table[at] - 1], ridge[m], (d - 1) * sizeof(int));) at = (at + 1) % (1 << 18);
        if (!table[at]) { met[m] = 0; place[m] = at; table[at] = ++m; }
        met[table[at] - 1]++;
      }
      cell[t] = cell[--cells];
    }
    EACH(i, m) { table[place[i]] = 0; if (met[i] % 2) join(ridge[i], p); } /* those that an odd number of cells has */
  }
  EACH(t, cells) { /* 3. the half-space <a, w - c> <= h cuts the cone of a cell inside the polytope, and holds the scaled task */
    I h = pt(cell[t].h); EACH(j, d) h = add(h, mul(pt(cell[t].a[j]), c[j]));
    need(mul(pt(lower), reach(cell[t].a)).hi <= h.lo, "the scaled task is not proved inside a cell's half-space", t);
  }
}
int main(void) {
  read_claim(); word("bounds"); double lower = number(), upper = number(); need(0 <= lower && lower <= upper, "bounds", -1);
  word("upper"); check_upper(upper);
  word("lower"); if (lower > 0) check_lower(lower); else need(!*text(), "more than a proof", -1);
  need(getchar() == EOF, "more than a proof", -1);
  printf("PROVED: %.17g <= mu <= %.17g\n", lower, upper);
  return 0;
}
