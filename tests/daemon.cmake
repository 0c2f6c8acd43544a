# SPDX-License-Identifier: MIT
foreach(module pages arena fetch cache visible)
	oocd_test(test_${module} unit SOURCES unit/test_${module}.c LINK oocd_core oocd_test_helper)
endforeach()

# The state machine with checks that a test can see fail.
oocd_test(test_node unit SOURCES unit/test_node.c ${CMAKE_SOURCE_DIR}/daemon/node.c
	LINK oocd_base oocd_test_helper)
target_compile_definitions(test_node PRIVATE OOCD_UNIT_TESTING)
