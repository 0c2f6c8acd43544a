/* SPDX-License-Identifier: MIT */
/**
 * inspect.h - what is told of nodes to those who look at the cache.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_SERVER_INSPECT_H
#define DAEMON_SERVER_INSPECT_H

#include <stdint.h>

#include "daemon/cache/served.h"
#include "libclient/wire.h"

/**
 * Describes the nodes first, first + 1, ... of a store.
 *
 * first:  any number.
 * ret:    WIRE_NODES_ENTRY_COUNT_MAX.
 *
 * Returns: how many there are in ret.
 */
uint32_t inspect_nodes(const struct served *served, uint32_t first, struct wire_node *ret);

#endif /* DAEMON_SERVER_INSPECT_H */
