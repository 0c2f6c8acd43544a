/* SPDX-License-Identifier: MIT */
/**
 * triangles.h - the triangles of stores and PLY files as multisets, compared bit by bit.
 *
 * A triangle is turned so that one corner is first, whatever an importer or a codec made of it;
 * which way it is wound counts.  Include it after <cmocka.h>.
 */
#ifndef TESTS_INTEGRATION_TRIANGLES_H
#define TESTS_INTEGRATION_TRIANGLES_H

#include <stddef.h>
#include <stdint.h>

/** The bits of three corners. */
struct triangle {
	double corners[3][3];
};

/** Sorted; the list is given back with free(). */
struct triangles {
	struct triangle *list;
	size_t count;
};

/** What a store has in its payloads, read by the library.  part: UINT32_MAX means all. */
struct triangles triangles_of_store(const char *path, uint32_t part);

/** What a PLY file of triangles has, ASCII or little-endian, positions float or double. */
struct triangles triangles_of_ply(const char *path);

/** Fails where one has what the other has not.  Gives both back. */
void assert_same_triangles(struct triangles a, struct triangles b);

#endif /* TESTS_INTEGRATION_TRIANGLES_H */
