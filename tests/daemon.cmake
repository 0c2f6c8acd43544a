# SPDX-License-Identifier: MIT
foreach(module pages arena disk fetch cache visible config)
	oocd_test(test_${module} unit SOURCES unit/test_${module}.c LINK oocd_core oocd_test_helper)
endforeach()

# The state machine with checks that a test can see fail.
oocd_test(test_node unit SOURCES unit/test_node.c ${CMAKE_SOURCE_DIR}/daemon/node.c
	LINK oocd_base oocd_test_helper)
target_compile_definitions(test_node PRIVATE OOCD_UNIT_TESTING)

add_library(oocd_daemon_kit STATIC ${CMAKE_CURRENT_LIST_DIR}/integration/daemon_kit.c)
target_link_libraries(oocd_daemon_kit PUBLIC oocd_core oocd_test_helper)

oocd_test(test_daemon integration SOURCES integration/test_daemon.c LINK oocd_daemon_kit)
oocd_test(test_daemon_faults integration SOURCES integration/test_daemon_faults.c
	LINK oocd_daemon_kit)
oocd_test(test_sharing integration SOURCES integration/test_sharing.c LINK oocd_daemon_kit)
oocd_test(test_daemon_program integration SOURCES integration/test_daemon_program.c
	LINK oocd_daemon_kit)
add_dependencies(test_daemon_program oocd)

oocd_test(test_reload integration SOURCES integration/test_reload.c LINK oocd_daemon_kit)

oocd_test(test_torn stress SOURCES stress/test_torn.c LINK oocd_daemon_kit)

oocd_test(test_daemon_calls fault SOURCES fault/test_daemon_calls.c LINK oocd_core oocd_test_helper)
target_link_options(test_daemon_calls PRIVATE
	-Wl,--wrap=calloc,--wrap=memfd_create,--wrap=fallocate64,--wrap=mmap64,--wrap=fchmod)
