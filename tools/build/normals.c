/* SPDX-License-Identifier: MIT */
#include "tools/build/normals.h"

#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "formats/base/bytes.h"
#include "formats/store/payload.h"

#define UNIT 32767
#define PI   3.14159265358979323846
/** So many shares are compared each with each, by bit masks. */
#define FEW_SHARES 64u
/** More directions than these at one position are rounded until they are fewer. */
#define CLUSTERS_MAX 1024u
#define CODED_BITS   10
#define CODED_COUNT  (1u << CODED_BITS)

/*
 * The angle of (x, y), y >= 0: 0 .. pi, to about 1e-5.  Not libm's, whose last bits differ between
 * machines.  Source: Abramowitz & Stegun 1964, 4.4.49, the minimax polynomial of the arctangent.
 */
static double angle_of(double x, double y)
{
	double ax = fabs(x);
	double low = ax < y ? ax : y;
	double high = ax < y ? y : ax;
	double t = high > 0 ? low / high : 0;
	double t2 = t * t;
	double angle =
		t * (0.9998660 +
		     t2 * (-0.3302995 + t2 * (0.1801410 + t2 * (-0.0851330 + t2 * 0.0208351))));

	if (ax < y)
		angle = PI / 2 - angle;
	return x < 0 ? PI - angle : angle;
}

void face_normal_of(const double corners[9], struct face_normal *ret)
{
	double edges[3][3];
	double cross[3];
	double length;

	for (unsigned i = 0; i < 3; i++)
		for (unsigned k = 0; k < 3; k++)
			edges[i][k] = corners[3 * ((i + 1) % 3) + k] - corners[3 * i + k];
	for (unsigned k = 0; k < 3; k++)
		cross[k] = edges[0][(k + 1) % 3] * edges[1][(k + 2) % 3] -
			   edges[0][(k + 2) % 3] * edges[1][(k + 1) % 3];
	length = sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]);
	for (unsigned k = 0; k < 3; k++)
		ret->normal[k] = length > 0 ? (int16_t)rint(cross[k] / length * UNIT) : 0;
	for (unsigned i = 0; i < 3; i++) {
		const double *out = edges[i];
		const double *in = edges[(i + 2) % 3];
		double cosine = -(out[0] * in[0] + out[1] * in[1] + out[2] * in[2]);

		ret->weights[i] = (uint16_t)(1 + (uint32_t)(angle_of(cosine, length) / PI * 65534));
	}
}

int32_t normals_threshold(double crease_degrees)
{
	return (int32_t)(cos(crease_degrees * PI / 180) * UNIT * UNIT);
}

static uint32_t encode_direction(enum normals_mode mode, const float direction[3])
{
	uint32_t code = 0;

	if (mode == NORMALS_OCT8) {
		int8_t bytes[2];

		payload_encode_oct8(direction, bytes);
		memcpy(&code, bytes, sizeof(bytes));
	} else {
		int16_t words[2];

		payload_encode_oct16(direction, words);
		memcpy(&code, words, sizeof(words));
	}
	return code;
}

/** Codes of late: what people build has few directions, and coding one is dear. */
struct coded {
	int64_t normal[3];
	uint32_t code;
	enum normals_mode mode; /* NORMALS_FLAT: empty */
};

uint32_t normals_encode(enum normals_mode mode, const int64_t normal[3])
{
	static _Thread_local struct coded cache[CODED_COUNT];
	uint64_t hash = (uint64_t)normal[0] * UINT64_C(0x9e3779b97f4a7c15) +
			(uint64_t)normal[1] * UINT64_C(0xc2b2ae3d27d4eb4f) +
			(uint64_t)normal[2] * UINT64_C(0x165667b19e3779f9);
	struct coded *coded = &cache[hash >> (64 - CODED_BITS)];

	if (coded->mode != mode || memcmp(coded->normal, normal, sizeof(coded->normal)) != 0) {
		double largest = 1;
		float direction[3];

		for (unsigned i = 0; i < 3; i++)
			largest = fmax(largest, fabs((double)normal[i]));
		for (unsigned i = 0; i < 3; i++)
			direction[i] = (float)((double)normal[i] / largest);
		memcpy(coded->normal, normal, sizeof(coded->normal));
		coded->code = encode_direction(mode, direction);
		coded->mode = mode;
	}
	return coded->code;
}

uint32_t normals_convert(enum normals_mode mode, uint32_t oct16)
{
	uint32_t code = 0;
	int16_t words[2];
	int8_t bytes[2];
	float direction[3];

	if (mode != NORMALS_OCT8)
		return oct16;
	memcpy(words, &oct16, sizeof(words));
	payload_decode_oct16(words, direction);
	payload_encode_oct8(direction, bytes);
	memcpy(&code, bytes, sizeof(bytes));
	return code;
}

static int32_t product(const int16_t a[3], const int16_t b[3])
{
	return (int32_t)a[0] * b[0] + (int32_t)a[1] * b[1] + (int32_t)a[2] * b[2];
}

/* Adds a normal with its weight, turned so that it agrees with `like`. */
static void add_share(int64_t sum[3], const int64_t weighted[3], int32_t likeness)
{
	for (unsigned k = 0; k < 3; k++)
		sum[k] += likeness < 0 ? -weighted[k] : weighted[k];
}

static bool is_zero(const int64_t sum[3])
{
	return sum[0] == 0 && sum[1] == 0 && sum[2] == 0;
}

static uint32_t encode_or_own(enum normals_mode mode, const int64_t sum[3], const int16_t own[3])
{
	const int64_t alone[3] = { own[0], own[1], own[2] };

	return normals_encode(mode, is_zero(sum) ? alone : sum);
}

/** Shares with one normal and one section: they count as one, with their weights added. */
struct direction {
	uint64_t packed; /* the normal's words */
	int16_t normal[3];
	uint32_t section;
	int64_t weight;
	uint64_t near;   /* bit j: direction j is within the crease */
	uint64_t turned; /* and faces the other way */
	uint32_t code;
};

static uint64_t pack(const int16_t normal[3])
{
	return (uint64_t)(uint16_t)normal[0] << 32 | (uint64_t)(uint16_t)normal[1] << 16 |
	       (uint16_t)normal[2];
}

/* The directions of some shares, and which of them each has.  Returns: how many. */
static uint32_t find_directions(const struct normal_share *shares, uint32_t count,
				struct direction directions[FEW_SHARES], uint8_t of[FEW_SHARES])
{
	uint32_t direction_count = 0;

	for (uint32_t i = 0; i < count; i++) {
		uint64_t packed = pack(shares[i].normal);
		uint32_t at = 0;

		while (at < direction_count && (directions[at].packed != packed ||
						directions[at].section != shares[i].section))
			at++;
		if (at == direction_count) {
			struct direction *direction = &directions[direction_count++];

			direction->packed = packed;
			memcpy(direction->normal, shares[i].normal, sizeof(direction->normal));
			direction->section = shares[i].section;
			direction->weight = 0;
			direction->near = UINT64_C(1) << at;
			direction->turned = 0;
		}
		directions[at].weight += shares[i].weight;
		of[i] = (uint8_t)at;
	}
	return direction_count;
}

static void compare_directions(struct direction *directions, uint32_t count, int32_t threshold)
{
	for (uint32_t i = 0; i < count; i++) {
		for (uint32_t j = i + 1; j < count; j++) {
			int32_t likeness = product(directions[i].normal, directions[j].normal);

			if (abs(likeness) < threshold ||
			    directions[i].section != directions[j].section)
				continue;
			directions[i].near |= UINT64_C(1) << j;
			directions[j].near |= UINT64_C(1) << i;
			if (likeness < 0) {
				directions[i].turned |= UINT64_C(1) << j;
				directions[j].turned |= UINT64_C(1) << i;
			}
		}
	}
}

static uint32_t code_of(enum normals_mode mode, const struct direction *directions, uint32_t count,
			uint32_t index)
{
	const struct direction *own = &directions[index];
	int64_t sum[3] = { 0, 0, 0 };

	/* The same faces, turned the same way, speak for an earlier direction too. */
	for (uint32_t i = 0; i < index; i++)
		if (directions[i].near == own->near && directions[i].turned == own->turned)
			return directions[i].code;
	for (uint32_t i = 0; i < count && own->near != UINT64_C(1) << index; i++) {
		int64_t weighted[3];

		if (!(own->near >> i & 1))
			continue;
		for (unsigned k = 0; k < 3; k++)
			weighted[k] = directions[i].normal[k] * directions[i].weight;
		add_share(sum, weighted, own->turned >> i & 1 ? -1 : 1);
	}
	return encode_or_own(mode, sum, own->normal);
}

/* Each direction with each.  Most points have one: flat surfaces are made of many triangles. */
static void solve_few(enum normals_mode mode, int32_t threshold, const struct normal_share *shares,
		      uint32_t count, uint32_t *ret)
{
	struct direction directions[FEW_SHARES];
	uint8_t of[FEW_SHARES];
	uint32_t direction_count = find_directions(shares, count, directions, of);

	compare_directions(directions, direction_count, threshold);
	for (uint32_t i = 0; i < direction_count; i++)
		directions[i].code = code_of(mode, directions, direction_count, i);
	for (uint32_t i = 0; i < count; i++)
		ret[i] = directions[of[i]].code;
}

/** Shares whose normals are the same, or nearly: what many of them are taken together as. */
struct cluster {
	uint64_t key; /* section and rounded normal */
	int64_t sum[3];
	int16_t normal[3]; /* of its members, rounded */
	uint32_t section;
	uint32_t code;
};

static uint64_t cluster_key(const struct normal_share *share, unsigned shift)
{
	uint64_t key = share->section;

	for (unsigned k = 0; k < 3; k++)
		key = key << 10 | (uint64_t)((share->normal[k] >> shift) & 0x3ff);
	return key;
}

static int compare_clusters(const void *a, const void *b)
{
	const struct cluster *left = a;
	const struct cluster *right = b;

	return (left->key > right->key) - (left->key < right->key);
}

/* Sorted clusters of the shares.  Returns: how many. */
static uint32_t make_clusters(const struct normal_share *shares, uint32_t count, unsigned shift,
			      struct cluster *clusters)
{
	uint32_t cluster_count = 0;

	for (uint32_t i = 0; i < count; i++) {
		clusters[i] = (struct cluster){ .key = cluster_key(&shares[i], shift),
						.section = shares[i].section };
		for (unsigned k = 0; k < 3; k++) {
			int32_t rounded =
				(shares[i].normal[k] >> shift) * (1 << shift) + (1 << shift) / 2;

			clusters[i].normal[k] = (int16_t)rounded;
			clusters[i].sum[k] = (int64_t)shares[i].normal[k] * shares[i].weight;
		}
	}
	qsort(clusters, count, sizeof(*clusters), compare_clusters);
	for (uint32_t i = 0; i < count; i++) {
		if (cluster_count > 0 && clusters[cluster_count - 1].key == clusters[i].key)
			add_share(clusters[cluster_count - 1].sum, clusters[i].sum, 1);
		else
			clusters[cluster_count++] = clusters[i];
	}
	return cluster_count;
}

/* What corners of one cluster get: the clusters of its section that are within the crease. */
static uint32_t solve_cluster(enum normals_mode mode, int32_t threshold,
			      const struct cluster *clusters, uint32_t cluster_count,
			      uint32_t cluster_index)
{
	const struct cluster *own = &clusters[cluster_index];
	int64_t sum[3] = { 0, 0, 0 };
	uint32_t begin = cluster_index;

	while (begin > 0 && clusters[begin - 1].section == own->section)
		begin--;
	for (uint32_t i = begin; i < cluster_count && clusters[i].section == own->section; i++) {
		int32_t likeness = product(own->normal, clusters[i].normal);

		if (i == cluster_index || abs(likeness) >= threshold)
			add_share(sum, clusters[i].sum, i == cluster_index ? 1 : likeness);
	}
	return encode_or_own(mode, sum, own->normal);
}

/*
 * A hub where very many faces meet.  Normals are rounded until the directions are few enough; the
 * keys sort them, so that the order in which they came does not matter.
 */
static int solve_many(enum normals_mode mode, int32_t threshold, const struct normal_share *shares,
		      uint32_t count, uint32_t *ret)
{
	struct cluster *clusters = malloc(count * sizeof(*clusters));
	unsigned shift = 6;
	uint32_t cluster_count;

	if (!clusters)
		return -ENOMEM;
	for (; (cluster_count = make_clusters(shares, count, shift, clusters)) > CLUSTERS_MAX;
	     shift++)
		/* Many sections may meet as well: they do not mix, so that each is small. */
		if (shift == 12)
			break;
	for (uint32_t i = 0; i < cluster_count; i++)
		clusters[i].code = solve_cluster(mode, threshold, clusters, cluster_count, i);
	for (uint32_t i = 0; i < count; i++) {
		struct cluster wanted = { .key = cluster_key(&shares[i], shift) };
		const struct cluster *found = bsearch(&wanted, clusters, cluster_count,
						      sizeof(*clusters), compare_clusters);

		ret[i] = found->code;
	}
	free(clusters);
	return 0;
}

int normals_solve(enum normals_mode mode, int32_t threshold, const struct normal_share *shares,
		  uint32_t share_count, uint32_t *ret)
{
	if (share_count > FEW_SHARES)
		return solve_many(mode, threshold, shares, share_count, ret);
	solve_few(mode, threshold, shares, share_count, ret);
	return 0;
}
