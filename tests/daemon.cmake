# SPDX-License-Identifier: MIT
oocd_test(test_pages unit SOURCES unit/test_pages.c LINK oocd_core oocd_test_helper)
oocd_test(test_arena unit SOURCES unit/test_arena.c LINK oocd_core oocd_test_helper)

# The state machine with checks that a test can see fail.
oocd_test(test_node unit SOURCES unit/test_node.c ${CMAKE_SOURCE_DIR}/daemon/node.c
	LINK oocd_base oocd_test_helper)
target_compile_definitions(test_node PRIVATE OOCD_UNIT_TESTING)
