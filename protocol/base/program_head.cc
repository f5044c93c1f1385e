#include "protocol/base/program_head.h"

#include <elf.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <string_view>

namespace myograde {
namespace {

// As much of a script's first line as the kernel reads.
constexpr size_t kHeadBytes = 256;
constexpr size_t kMaxInterpreter = 4096;
constexpr int kMaxSegments = 64;

#if defined(__x86_64__)
constexpr Elf64_Half kMachine = EM_X86_64;
#elif defined(__aarch64__)
constexpr Elf64_Half kMachine = EM_AARCH64;
#else
constexpr Elf64_Half kMachine = EM_NONE;
#endif

std::string ProcessorName(Elf64_Half machine, bool wide) {
  switch (machine) {
    case EM_X86_64: return wide ? "x86-64" : "x32";
    case EM_386: return "32-bit x86";
    case EM_AARCH64: return "AArch64";
    case EM_ARM: return "32-bit ARM";
    case EM_RISCV: return "RISC-V";
    default: return "another processor (ELF machine " + std::to_string(machine) + ")";
  }
}

std::string ReadLoader(int fd, const Elf64_Ehdr& header) {
  const int segments = std::min<int>(header.e_phnum, kMaxSegments);
  for (int i = 0; i < segments; ++i) {
    Elf64_Phdr segment;
    const auto at = static_cast<off_t>(header.e_phoff + static_cast<uint64_t>(i) * sizeof(segment));
    if (::pread(fd, &segment, sizeof(segment), at) != sizeof(segment)) return "";
    if (segment.p_type != PT_INTERP) continue;
    std::string path(std::min<size_t>(segment.p_filesz, kMaxInterpreter), '\0');
    const ssize_t size =
        ::pread(fd, path.data(), path.size(), static_cast<off_t>(segment.p_offset));
    if (size <= 0) return "";
    path.resize(static_cast<size_t>(size));
    return path.substr(0, path.find('\0'));
  }
  return "";
}

ProgramHead BinaryHead(int fd, std::string_view bytes) {
  ProgramHead head;
  Elf64_Ehdr header = {};
  std::memcpy(&header, bytes.data(), std::min(bytes.size(), sizeof(header)));
  const bool wide = header.e_ident[EI_CLASS] == ELFCLASS64;
  // e_machine has the same offset for both word sizes.
  if (!wide || header.e_machine != kMachine) {
    head.kind = ProgramHead::Kind::kForeign;
    head.processor = ProcessorName(header.e_machine, wide);
    return head;
  }
  head.kind = ProgramHead::Kind::kBinary;
  head.interpreter = ReadLoader(fd, header);
  return head;
}

std::string_view Trimmed(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

}  // namespace

ProgramHead ReadProgramHead(int fd) {
  std::string buffer(kHeadBytes, '\0');
  const ssize_t size = ::pread(fd, buffer.data(), buffer.size(), 0);
  std::string_view bytes(buffer.data(), static_cast<size_t>(std::max<ssize_t>(size, 0)));
  if (bytes.size() >= EI_NIDENT + 4 && bytes.starts_with(ELFMAG)) return BinaryHead(fd, bytes);
  ProgramHead head;
  if (!bytes.starts_with("#!")) return head;
  const std::string_view line = Trimmed(bytes.substr(2, bytes.find('\n') - 2));
  const size_t blank = std::min(line.find_first_of(" \t"), line.size());
  head.kind = ProgramHead::Kind::kScript;
  head.windows_line_end = line.ends_with('\r');
  head.interpreter = std::string(line.substr(0, blank));
  head.argument = std::string(Trimmed(line.substr(blank)));
  return head;
}

}  // namespace myograde
