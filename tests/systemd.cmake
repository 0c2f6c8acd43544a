# SPDX-License-Identifier: MIT
add_test(NAME integration.socket_activation
	COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/integration/socket_activation.sh)
set_tests_properties(integration.socket_activation PROPERTIES
	LABELS integration TIMEOUT 120 SKIP_RETURN_CODE 77
	ENVIRONMENT "OOCD_BIN=${CMAKE_BINARY_DIR}/bin;OOCD_SOURCE=${CMAKE_SOURCE_DIR}")

# Units are the same whatever the compiler: once is enough, with what people run.
if(CMAKE_C_COMPILER_ID STREQUAL "GNU" AND NOT OOCD_SANITIZE)
	add_test(NAME systemd.units COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/systemd/units.sh
		${CMAKE_BINARY_DIR} ${CMAKE_INSTALL_PREFIX})
	set_tests_properties(systemd.units PROPERTIES
		LABELS systemd TIMEOUT 120 SKIP_RETURN_CODE 77 RESOURCE_LOCK systemd)
endif()

add_executable(without integration/without.c)
target_link_libraries(without PRIVATE oocd_flags)
set_target_properties(without PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
if(NOT OOCD_SANITIZE)
	add_test(NAME integration.degraded
		COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/integration/degraded.sh ${CMAKE_BINARY_DIR}/tests)
	set(degraded integration.degraded)
	# All that is promised of a daemon holds there, too.
	foreach(test test_daemon test_daemon_faults test_daemon_trace test_sharing test_reload
			test_counters test_hostile test_client_daemon test_look_ahead test_oocctl_daemon
			test_oocctl_steer)
		add_test(NAME degraded.${test} COMMAND without $<TARGET_FILE:${test}>)
		list(APPEND degraded degraded.${test})
	endforeach()
	set_tests_properties(${degraded} PROPERTIES LABELS integration TIMEOUT 120
		ENVIRONMENT "OOCD_BIN=${CMAKE_BINARY_DIR}/bin;OOCD_SOURCE=${CMAKE_SOURCE_DIR}")
endif()
