# Fails if a program lacks what hardening gives it. Run: cmake -D PROGRAM=... -D READELF=... [-D OBJDUMP=...]
# -P hardening.cmake; with OBJDUMP, looks at the instructions too, of a processor of the x86-64 family.
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

if(NOT OBJDUMP OR NOT text MATCHES "Machine: +Advanced Micro Devices X86-64")
  return()
endif()
# Marks at the targets of jumps, at more than the few of the compiler's own start; pages of a large frame, touched.
foreach(instruction "endbr64;100" "or[ql] +\\$0x0,\\(%rsp\\);1")
  list(POP_BACK instruction least)
  execute_process(COMMAND ${OBJDUMP} --disassemble --no-show-raw-insn ${PROGRAM}
                  COMMAND grep -cE "${instruction}" OUTPUT_VARIABLE count OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(count LESS least)
    message(SEND_ERROR "${PROGRAM} has ${count} instructions '${instruction}', not ${least}")
  endif()
endforeach()
