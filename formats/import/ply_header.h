/* SPDX-License-Identifier: MIT */
/**
 * ply_header.h - what a PLY file says before its data: elements, their properties, how many.
 *
 * Source: G. Turk, "The PLY Polygon File Format", 1994.
 */
#ifndef FORMATS_IMPORT_PLY_HEADER_H
#define FORMATS_IMPORT_PLY_HEADER_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/import/source.h"
#include "formats/store/layout.h"

#define PLY_ELEMENTS_MAX   32u
#define PLY_PROPERTIES_MAX 128u
#define PLY_NAME_BYTES     64u

enum ply_encoding {
	PLY_ASCII,
	PLY_LITTLE_ENDIAN,
	PLY_BIG_ENDIAN,
};

enum ply_type {
	PLY_NONE, /* the count's type of what is no list */
	PLY_INT8,
	PLY_UINT8,
	PLY_INT16,
	PLY_UINT16,
	PLY_INT32,
	PLY_UINT32,
	PLY_FLOAT,
	PLY_DOUBLE,
	PLY_TYPE_COUNT_
};

/** Size of a value in a binary file. */
extern const uint8_t ply_type_bytes[PLY_TYPE_COUNT_];

struct ply_property {
	char name[PLY_NAME_BYTES];
	enum ply_type type;       /* of the value, or of a list's values */
	enum ply_type count_type; /* PLY_NONE: it is no list */
};

struct ply_element {
	char name[PLY_NAME_BYTES];
	uint64_t count;
	struct ply_property *properties;
	uint32_t property_count;
	bool has_list;
	uint32_t row_bytes_min; /* exact in a binary file without lists */
};

struct ply_header {
	enum ply_encoding encoding;
	struct ply_element elements[PLY_ELEMENTS_MAX];
	uint32_t element_count;
	double unit_metres;      /* of "comment unit metres"; 0: it does not say */
	enum store_axis up_axis; /* of "comment up z" */
};

/**
 * Reads the header; the source then stands on the first byte of the data.  Counts are compared with
 * what the rest of the file can hold.
 *
 * Returns: 0, -EUCLEAN, -ENODATA, -ENOMEM or as source_more().
 * Ownership: ends with ply_header_done(), also after a failure.
 */
int ply_header_read(struct source *source, struct ply_header *ret, struct why *why);
void ply_header_done(struct ply_header *header);

/** The property of that name, or its number; UINT32_MAX when there is none. */
uint32_t ply_element_find(const struct ply_element *element, const char *name);

#endif /* FORMATS_IMPORT_PLY_HEADER_H */
