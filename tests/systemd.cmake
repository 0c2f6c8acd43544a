# SPDX-License-Identifier: MIT
add_test(NAME integration.socket_activation
	COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/integration/socket_activation.sh)
set_tests_properties(integration.socket_activation PROPERTIES
	LABELS integration TIMEOUT 120 SKIP_RETURN_CODE 77
	ENVIRONMENT "OOCD_BIN=${CMAKE_BINARY_DIR}/bin;OOCD_SOURCE=${CMAKE_SOURCE_DIR}")
