/* The entry point that Windows calls when it loads or unloads a library without a C run time of its own. Not part of sources/: a
 * compiler that links its own run time provides one. */
int __stdcall DllMainCRTStartup(void *library, unsigned long reason, void *reserved);

int __stdcall DllMainCRTStartup(void *library, unsigned long reason, void *reserved)
{
    (void)library;
    (void)reason;
    (void)reserved;
    return 1;
}
