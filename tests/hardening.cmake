# Fails if a program lacks what hardening gives it. Run: cmake -D PROGRAM=... -D READELF=... -P hardening.cmake
cmake_minimum_required(VERSION 3.25)
execute_process(COMMAND ${READELF} --wide --file-header --program-headers --dynamic --symbols ${PROGRAM}
                OUTPUT_VARIABLE text COMMAND_ERROR_IS_FATAL ANY)
foreach(part "Type: +DYN" "GNU_RELRO" "BIND_NOW|FLAGS_1.*NOW" "__stack_chk_fail" "__[a-z]+_chk@")
  if(NOT text MATCHES "${part}")
    message(SEND_ERROR "${PROGRAM} is built without ${part}")
  endif()
endforeach()
if(text MATCHES "GNU_STACK [^\n]*RWE")
  message(SEND_ERROR "${PROGRAM} has a stack that can be run")
endif()
