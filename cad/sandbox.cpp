// SPDX-License-Identifier: Apache-2.0
//
// A seccomp filter (Linux 3.5). It lists what is forbidden, not what is allowed: the C library's own calls differ
// between versions, and a forgotten one would end a reading that is harmless.
#include "cad/sandbox.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace slabd::cad {
namespace {

#if defined(__x86_64__)
constexpr unsigned kMachine = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr unsigned kMachine = AUDIT_ARCH_AARCH64;
#else
#error "the filter needs the name of this machine"
#endif

constexpr std::array kForbidden = {
    SYS_socket,    SYS_socketpair, SYS_connect,   SYS_bind,           SYS_listen,    SYS_accept,  SYS_accept4,
    SYS_sendto,    SYS_sendmsg,    SYS_execve,    SYS_execveat,       SYS_clone3,    SYS_ptrace,  SYS_kill,
    SYS_tgkill,    SYS_unlinkat,   SYS_renameat2, SYS_linkat,         SYS_symlinkat, SYS_mkdirat, SYS_mknodat,
    SYS_fchmodat,  SYS_fchownat,   SYS_truncate,  SYS_mount,          SYS_umount2,   SYS_unshare, SYS_setns,
    SYS_openat2,   SYS_bpf,        SYS_keyctl,    SYS_io_uring_setup, SYS_tkill,     SYS_fchmod,  SYS_fchown,
    SYS_utimensat, SYS_setsid,     SYS_setpgid,   SYS_fsetxattr,      SYS_setxattr,  SYS_clone,   SYS_rt_sigqueueinfo,
#if defined(__x86_64__)
    SYS_fork,      SYS_vfork,      SYS_unlink,    SYS_rename,         SYS_renameat,  SYS_link,    SYS_symlink,
    SYS_mkdir,     SYS_rmdir,      SYS_creat,     SYS_chmod,          SYS_chown,     SYS_open,    SYS_mknod,
#endif
};

constexpr unsigned field(std::size_t offset) {
  return static_cast<unsigned>(offset);
}

}  // namespace

bool confine() {
  constexpr unsigned kLoad = BPF_LD | BPF_W | BPF_ABS;
  constexpr unsigned kIfEqual = BPF_JMP | BPF_JEQ | BPF_K;
  const auto step = [](unsigned code, unsigned value, unsigned yes = 0, unsigned no = 0) {
    return sock_filter{static_cast<unsigned short>(code), static_cast<unsigned char>(yes),
                       static_cast<unsigned char>(no), value};
  };
  const sock_filter refuse = step(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM);
  std::vector<sock_filter> filter = {
      step(kLoad, field(offsetof(seccomp_data, arch))),
      step(kIfEqual, kMachine, 1, 0),
      step(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
      step(kLoad, field(offsetof(seccomp_data, nr))),
  };
#if defined(__x86_64__)
  // Calls of the ABI x32 have the same machine and other numbers.
  constexpr unsigned kX32 = 0x40000000U;
  filter.push_back(step(BPF_JMP | BPF_JGE | BPF_K, kX32, 0, 1));
  filter.push_back(refuse);
#endif
  for (const long call : kForbidden) {
    filter.push_back(step(kIfEqual, static_cast<unsigned>(call), 0, 1));
    filter.push_back(refuse);
  }
  // openat: only for reading. The flags are the third argument; their lower half is in the first four bytes.
  filter.push_back(step(kIfEqual, SYS_openat, 0, 3));
  filter.push_back(step(kLoad, field(offsetof(seccomp_data, args) + 2 * sizeof(std::uint64_t))));
  filter.push_back(step(BPF_JMP | BPF_JSET | BPF_K, O_WRONLY | O_RDWR | O_CREAT | O_TRUNC, 0, 1));
  filter.push_back(refuse);
  filter.push_back(step(BPF_RET | BPF_K, SECCOMP_RET_ALLOW));
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return false;  // a sanitizer reports through processes and files of its own
#endif
  return ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

}  // namespace slabd::cad
