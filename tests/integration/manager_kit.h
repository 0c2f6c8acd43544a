/* SPDX-License-Identifier: MIT */
/**
 * manager_kit.h - a service manager for tests: tools/bench/base/manager.h, what goes wrong with it fails
 * the test.  Include it after <cmocka.h>.
 */
#ifndef TESTS_INTEGRATION_MANAGER_KIT_H
#define TESTS_INTEGRATION_MANAGER_KIT_H

#include "tools/bench/base/manager.h"

struct manager *kit_manager_create(const char *folder);
/** Starts the oocd that is tested. */
void kit_manager_start(struct manager *manager, const char *const *options);
void kit_manager_await(struct manager *manager, const char *part, uint32_t count);
void kit_manager_await_kept(struct manager *manager, const char *part, uint32_t count);

#endif /* TESTS_INTEGRATION_MANAGER_KIT_H */
