/* SPDX-License-Identifier: MIT */
/**
 * ctl.h - what the verbs of oocctl share.
 *
 * A verb is a function with a command line of its own; it says what went wrong itself, in one line,
 * and returns the program's exit status: 0, 1 (failed) or 2 (wrong usage).
 */
#ifndef TOOLS_CTL_CTL_H
#define TOOLS_CTL_CTL_H

#include <stdbool.h>
#include <stdint.h>

#include "formats/store/store_file.h"

#define CTL_OK     0
#define CTL_FAILED 1
#define CTL_USAGE  2

int ctl_clients(int argc, char **argv);
int ctl_dump(int argc, char **argv);
int ctl_evict(int argc, char **argv);
int ctl_export(int argc, char **argv);
int ctl_info(int argc, char **argv);
int ctl_map(int argc, char **argv);
int ctl_metrics(int argc, char **argv);
int ctl_nodes(int argc, char **argv);
int ctl_parts(int argc, char **argv);
int ctl_pin(int argc, char **argv);
int ctl_prefetch(int argc, char **argv);
int ctl_reload(int argc, char **argv);
int ctl_status(int argc, char **argv);
int ctl_stores(int argc, char **argv);
int ctl_top(int argc, char **argv);
int ctl_unpin(int argc, char **argv);
int ctl_trace(int argc, char **argv);
int ctl_verify(int argc, char **argv);

/** Says that the command line is wrong and where the right one stands.  Returns: CTL_USAGE. */
int ctl_usage(const char *verb, const char *what);

/**
 * Takes the options of a verb that has none but --json and --help; what is left begins at optind.
 *
 * Returns: CTL_OK to go on, -1 after --help, or CTL_USAGE.
 */
int ctl_parse_json(int argc, char **argv, const char *help, bool *ret_json);

/** A store, its HS and its names, open for a verb. */
struct ctl_store {
	struct store_file *file;
	const struct store_superblock *superblock;
	struct store_node *nodes;
	struct store_names names;
};

/** Opens all of it, or says why not.  Returns: an exit status.  Ends with ctl_store_close(). */
int ctl_store_open(const char *path, struct ctl_store *ret);
void ctl_store_close(struct ctl_store *store);

/** A string of the names block. */
static inline const char *ctl_string(const struct store_names *names, uint64_t offset)
{
	return names->strings + offset;
}

/** Does a shell pattern match a part's name, its scene path or its section's name? */
bool ctl_part_matches(const struct store_names *names, uint64_t part_index, const char *pattern);

/** Room for one payload, decoded and stored; reused from node to node. */
struct ctl_payload {
	void *decoded;
	void *stored;
};

/** Returns: 0 or -ENOMEM, said.  Ends with ctl_payload_done(). */
int ctl_payload_init(struct ctl_payload *ret, const struct ctl_store *store);
void ctl_payload_done(struct ctl_payload *payload);

#endif /* TOOLS_CTL_CTL_H */
