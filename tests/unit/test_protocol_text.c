/* SPDX-License-Identifier: MIT */
/*
 * libclient/PROTOCOL.md against wire.h: each field of a table is where and as long as in C, each field
 * in C is in a table, each number and limit is the same.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/limits.h"
#include "formats/base/bytes.h"
#include "libclient/wire.h"
#include "tests/helper.h"
#include "tests/unit/wire_samples.h"

/* One field in C.  element_bytes is 0 but for an array that the message is as long as it needs. */
struct field {
	const char *table;
	const char *name;
	size_t offset;
	size_t bytes;
	size_t element_bytes;
	bool was_seen;
};

#define FIELD(table_name, struct_name, member)                                                     \
	{                                                                                          \
		table_name, #member, offsetof(struct struct_name, member),                         \
			sizeof(((struct struct_name *)NULL)->member), 0, false                     \
	}
#define ARRAY(table_name, struct_name, member)                                                     \
	{                                                                                          \
		table_name, #member, offsetof(struct struct_name, member), 0,                      \
			sizeof(((struct struct_name *)NULL)->member[0]), false                     \
	}

static struct field fields[] = {
	FIELD("header", wire_header, type),
	FIELD("header", wire_header, reserved),
	FIELD("header", wire_header, bytes),
	FIELD("HELLO", wire_hello, version),
	FIELD("HELLO", wire_hello, reserved),
	FIELD("HELLO", wire_hello, name),
	FIELD("OPEN", wire_open, store),
	FIELD("OPEN", wire_open, reserved),
	FIELD("OPEN", wire_open, path),
	FIELD("CLOSE", wire_close, store),
	FIELD("CLOSE", wire_close, reserved),
	FIELD("SET", wire_set, serial),
	FIELD("SET", wire_set, flags),
	FIELD("SET", wire_set, entry_count),
	ARRAY("SET", wire_set, entries),
	FIELD("entry", wire_entry, store),
	FIELD("entry", wire_entry, node),
	FIELD("entry", wire_entry, importance),
	FIELD("RETIRE", wire_retire, serial),
	FIELD("PREFETCH", wire_prefetch, entry_count),
	FIELD("PREFETCH", wire_prefetch, reserved),
	ARRAY("PREFETCH", wire_prefetch, entries),
	FIELD("STATUS", wire_status, what),
	FIELD("STATUS", wire_status, store),
	FIELD("STATUS", wire_status, first),
	FIELD("STATUS", wire_status, reserved),
	FIELD("ADMIN", wire_admin, what),
	FIELD("ADMIN", wire_admin, store),
	FIELD("ADMIN", wire_admin, node_count),
	FIELD("ADMIN", wire_admin, reserved),
	ARRAY("ADMIN", wire_admin, nodes),
	FIELD("NODES", wire_nodes, store),
	FIELD("NODES", wire_nodes, first),
	FIELD("NODES", wire_nodes, entry_count),
	FIELD("NODES", wire_nodes, reserved),
	ARRAY("NODES", wire_nodes, entries),
	FIELD("node", wire_node, order),
	FIELD("node", wire_node, age_ds),
	FIELD("node", wire_node, holds),
	FIELD("node", wire_node, payer),
	FIELD("node", wire_node, cached),
	FIELD("node", wire_node, flags),
	FIELD("WELCOME", wire_welcome, version),
	FIELD("WELCOME", wire_welcome, session),
	FIELD("WELCOME", wire_welcome, epoch),
	FIELD("WELCOME", wire_welcome, page_bytes),
	FIELD("OPENED", wire_opened, store),
	FIELD("OPENED", wire_opened, segment_bytes_log2),
	FIELD("OPENED", wire_opened, generation),
	FIELD("OPENED", wire_opened, node_count),
	FIELD("OPENED", wire_opened, uuid),
	FIELD("OPENED", wire_opened, hs_bytes),
	FIELD("OPENED", wire_opened, directory_bytes),
	FIELD("OPENED", wire_opened, grants_bytes),
	FIELD("SEGMENT", wire_segment, store),
	FIELD("SEGMENT", wire_segment, segment),
	FIELD("SEGMENT", wire_segment, segment_bytes),
	FIELD("SEGMENT_GONE", wire_segment_gone, store),
	FIELD("SEGMENT_GONE", wire_segment_gone, segment),
	FIELD("EVENT", wire_event, serial),
	FIELD("EVENT", wire_event, settled),
	FIELD("EVENT", wire_event, complete),
	FIELD("EVENT", wire_event, missing_count),
	FIELD("NOT_NOW", wire_not_now, serial),
	FIELD("NOT_NOW", wire_not_now, entry_count),
	FIELD("NOT_NOW", wire_not_now, reserved),
	ARRAY("NOT_NOW", wire_not_now, entries),
	FIELD("refusal", wire_refusal, store),
	FIELD("refusal", wire_refusal, node),
	FIELD("refusal", wire_refusal, reason),
	FIELD("TEXT", wire_text, last),
	FIELD("TEXT", wire_text, text_bytes),
	ARRAY("TEXT", wire_text, text),
	FIELD("ERROR", wire_error, error),
	FIELD("ERROR", wire_error, type),
	FIELD("ERROR", wire_error, store),
	FIELD("ERROR", wire_error, version),
	FIELD("ERROR", wire_error, text),
	FIELD("RECALL", wire_recall, serial),
	FIELD("session page", wire_session_page, epoch),
	FIELD("session page", wire_session_page, acknowledged),
	FIELD("session page", wire_session_page, settled),
	FIELD("session page", wire_session_page, complete),
	FIELD("session page", wire_session_page, fetched_bytes),
	FIELD("session page", wire_session_page, prefetched_bytes),
	FIELD("session page", wire_session_page, cache_bytes),
	FIELD("session page", wire_session_page, cache_used_bytes),
	FIELD("session page", wire_session_page, message_count),
	FIELD("session page", wire_session_page, beat),
	FIELD("directory", wire_directory, generation),
	FIELD("directory", wire_directory, node_count),
	FIELD("directory", wire_directory, epoch),
	FIELD("directory", wire_directory, reserved),
	ARRAY("directory", wire_directory, words),
	FIELD("grants", wire_grants, epoch),
	FIELD("grants", wire_grants, node_count),
	FIELD("grants", wire_grants, reserved),
	ARRAY("grants", wire_grants, words),
};

static char *text_read(void)
{
	char path[4096];
	size_t bytes;
	char *text;
	char *longer;

	(void)snprintf(path, sizeof(path), "%s/libclient/PROTOCOL.md", getenv("OOCD_SOURCE"));
	text = test_file_read(path, &bytes);
	longer = realloc(text, bytes + 1);
	assert_non_null(longer);
	longer[bytes] = '\0';
	return longer;
}

static struct field *field_find(const char *table, const char *name)
{
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++) {
		if (strcmp(fields[i].table, table) == 0 && strcmp(fields[i].name, name) == 0)
			return &fields[i];
	}
	return NULL;
}

/* "| 8 | 4 | u32 | version | 1 |" or "| 24 | 12 x entry_count | entry | entries | ... |" */
static void row_check(const char *table, const char *row)
{
	char name[64];
	char times[64] = "";
	size_t offset;
	size_t bytes;
	struct field *field;

	if (sscanf(row, "| %zu | %zu %63[^|]| %*[^|]| %63[a-z0-9_] |", &offset, &bytes, times,
		   name) != 4 &&
	    sscanf(row, "| %zu | %zu | %*[^|]| %63[a-z0-9_] |", &offset, &bytes, name) != 3)
		fail_msg("%s: not a row: %s", table, row);
	field = field_find(table, name);
	if (!field)
		fail_msg("%s.%s is in the text and not in wire.h", table, name);
	if (field->offset != offset)
		fail_msg("%s.%s is at %zu, the text says %zu", table, name, field->offset, offset);
	if ((times[0] == 'x' ? field->element_bytes : field->bytes) != bytes)
		fail_msg("%s.%s has not %zu bytes, as the text says", table, name, bytes);
	field->was_seen = true;
}

static void every_field_is_where_the_text_says(void **state)
{
	char *text = text_read();
	char table[64] = "";
	bool is_fields = false;

	(void)state;
	for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
		if (strncmp(line, "### ", 4) == 0) {
			assert_int_equal(sscanf(line, "### %63[A-Za-z_ ]", table), 1);
			if (table[strlen(table) - 1] == ' ')
				table[strlen(table) - 1] = '\0';
		} else if (line[0] != '|') {
			is_fields = false;
		} else if (strncmp(line, "| offset ", 9) == 0) {
			is_fields = true;
		} else if (is_fields && line[1] != '-') {
			row_check(table, line);
		}
	}
	for (size_t i = 0; i < ARRAY_LENGTH(fields); i++) {
		if (!fields[i].was_seen)
			fail_msg("%s.%s is in wire.h and not in the text", fields[i].table,
				 fields[i].name);
	}
	free(text);
}

static void every_message_has_the_number_that_the_text_says(void **state)
{
	char *text = text_read();
	unsigned count = 0;

	(void)state;
	for (uint16_t type = 0; type < 256; type++) {
		char heading[64];

		if (strchr(wire_type_name(type), ' '))
			continue;
		(void)snprintf(heading, sizeof(heading), "\n### %s (%u)\n", wire_type_name(type),
			       type);
		if (!strstr(text, heading))
			fail_msg("the text has no heading%s", heading);
		count++;
	}
	assert_int_equal(count, WIRE_SAMPLE_COUNT);
	free(text);
}

static void every_limit_is_what_the_text_says(void **state)
{
	static const struct {
		const char *what;
		uint64_t limit;
	} limits[] = {
		{ "bytes of a message", WIRE_MESSAGE_BYTES_MAX },
		{ "descriptors of a message", WIRE_FD_COUNT_MAX },
		{ "stores of a session", WIRE_STORE_COUNT_MAX },
		{ "nodes of a set", WIRE_SET_NODE_COUNT_MAX },
		{ "segments of a store", WIRE_SEGMENT_COUNT_MAX },
		{ "pages of a segment", WIRE_SEGMENT_PAGES_MAX },
		{ "seconds from RECALL to its answer", LEASE_MS_USUAL / 1000 },
	};
	char *text = text_read();
	char phrase[128];

	(void)state;
	for (size_t i = 0; i < ARRAY_LENGTH(limits); i++) {
		(void)snprintf(phrase, sizeof(phrase), "\n| %s | %llu |", limits[i].what,
			       (unsigned long long)limits[i].limit);
		if (!strstr(text, phrase))
			fail_msg("the text does not say%s", phrase);
	}
	(void)snprintf(phrase, sizeof(phrase), "(%zu entries fit into one)",
		       WIRE_SET_ENTRY_COUNT_MAX);
	assert_non_null(strstr(text, phrase));
	(void)snprintf(phrase, sizeof(phrase), "; %u..%u |", WIRE_SEGMENT_LOG2_MIN,
		       WIRE_SEGMENT_LOG2_MAX);
	assert_non_null(strstr(text, phrase));
	(void)snprintf(phrase, sizeof(phrase), "# The protocol of oocd, version %u\n",
		       WIRE_VERSION);
	assert_non_null(strstr(text, phrase));
	free(text);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_field_is_where_the_text_says),
		cmocka_unit_test(every_message_has_the_number_that_the_text_says),
		cmocka_unit_test(every_limit_is_what_the_text_says),
	};

	return TEST_RUN(tests);
}
