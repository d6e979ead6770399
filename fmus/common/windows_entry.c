/* What Windows calls when it loads or leaves a library that brings no C run time of its own. Not part of sources/: a compiler
 * with its run time has one. */
int __stdcall DllMainCRTStartup(void *library, unsigned long reason, void *reserved);

int __stdcall DllMainCRTStartup(void *library, unsigned long reason, void *reserved)
{
    (void)library;
    (void)reason;
    (void)reserved;
    return 1;
}
