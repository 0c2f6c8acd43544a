/* SPDX-License-Identifier: MIT */
/**
 * ctl_daemon.h - what the verbs that ask the daemon share: their common options, the connection, its
 * JSON, cells of tables.
 *
 * The daemon's words are JSON and belong to it: programs get them as they are, people get tables of
 * what is known here, and a key that is missing shows as "-".
 */
#ifndef TOOLS_CTL_CTL_DAEMON_H
#define TOOLS_CTL_CTL_DAEMON_H

#include <getopt.h>
#include <jansson.h>

#include "libclient/ooc/client.h"
#include "tools/ctl/ctl.h"

/** One run of a verb. */
struct ctl_request {
	const char *verb;
	const char *help;
	const char *socket_path; /* NULL: the usual places */
	bool json;
	struct ooc_client *client; /* once ctl_connect() has succeeded */
};

/** Of every such verb; getopt_long() values 'j', 's' and 'h'. */
/* clang-format off */
#define CTL_COMMON_OPTIONS                               \
	{ "json", no_argument, NULL, 'j' },              \
	{ "socket", required_argument, NULL, 's' },      \
	{ "help", no_argument, NULL, 'h' }
/* clang-format on */

/** How the common options are told in a --help. */
#define CTL_COMMON_HELP                                                                               \
	"      --socket S      the daemon's socket; else $OOCD_SOCKET, the system's, or the user's\n" \
	"      --help          this text"

/**
 * Takes one of the common options.
 *
 * Returns: CTL_OK to go on, -1 after --help, or CTL_USAGE.
 */
int ctl_common_option(struct ctl_request *request, int option);

/** For verbs that have no other option.  Returns: as above, and whether argument_count are left. */
int ctl_parse_common(int argc, char **argv, struct ctl_request *request, int argument_count);

/** Connects; never starts a daemon.  Returns: CTL_OK, or CTL_FAILED, said. */
int ctl_connect(struct ctl_request *request);

/** Connects and opens a store.  Returns: as above. */
int ctl_connect_store(struct ctl_request *request, const char *path, struct ooc_store **ret);

/** The status as a tree.  The caller's, ended with json_decref(); NULL: said why. */
json_t *ctl_status_tree(struct ctl_request *request);

/** Prints a tree for programs. */
void ctl_print_json(const json_t *value);

/** Nodes that are named on a command line: "1,5-9,12", or "-" for standard input. */
struct ctl_nodes {
	uint32_t *nodes;
	size_t count;
};

/** Returns: CTL_OK, or CTL_USAGE or CTL_FAILED, said.  Ownership: free(ret->nodes). */
int ctl_nodes_parse(const struct ctl_request *request, const char *text, struct ctl_nodes *ret);

/** A count of seconds, or a fraction of them.  Returns: is it one? */
bool ctl_seconds_parse(const char *text, double *ret);

/* ---- cells of tables; each begins with a blank ---- */

/** A member's number; 0 where it has none. */
double ctl_number(const json_t *object, const char *key);
const char *ctl_text(const json_t *object, const char *key);
void ctl_print_number(const json_t *object, const char *key, int width);
void ctl_print_size(const json_t *object, const char *key, int width);
/** part of part + rest, in percent. */
void ctl_print_share(double part, double rest, int width);

/** What a status has, as tables. */
void ctl_print_stores(const json_t *stores);
void ctl_print_clients(const json_t *clients);
/** Who owes whom how many nodes, a line a client that owes any. */
void ctl_print_debts(const json_t *clients);

#endif /* TOOLS_CTL_CTL_DAEMON_H */
