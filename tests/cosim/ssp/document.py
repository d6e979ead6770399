"""SSP descriptions, parameter sets and mappings, as other tools write them."""

NAMESPACES = "".join(
    f' xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (
        ("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"), ("ssm", "ParameterMapping"),
    )
)  # fmt: skip
UNITS = """<ssd:Units>
<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="mm"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="m/s"><ssc:BaseUnit m="1" s="-1"/></ssc:Unit>
<ssc:Unit name="swift"><ssc:BaseUnit m="1" s="-1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="brisk"><ssc:BaseUnit m="1" s="-1" factor="1.25"/></ssc:Unit>
<ssc:Unit name="N"><ssc:BaseUnit kg="1" m="1" s="-2"/></ssc:Unit>
</ssd:Units>"""
EXPERIMENT = '<ssd:DefaultExperiment startTime="0" stopTime="0.3"/>'


def connectors(**names):
    """Return the XML of connectors given as `velocity="output m/s"`."""
    lines = ""
    for name, text in names.items():
        kind, _, unit = text.partition(" ")
        lines += f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real{f""" unit="{unit}" """ if unit else ""}/>'
        lines += "</ssd:Connector>"
    return f"<ssd:Connectors>{lines}</ssd:Connectors>"


def component(name, source, ports="", extra="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<ssd:Component name="{name}" source="{source}"{given}>{ports}{extra}</ssd:Component>'


def link(start, end, inside="", **attributes):
    """Return the XML of a connection; an end is `car.velocity` or, for a system connector, `:velocity`."""
    ends = ""
    for which, text in (("start", start), ("end", end)):
        element, _, name = text.partition(":" if text.startswith(":") else ".")
        ends += (f' {which}Element="{element}"' if element else "") + f' {which}Connector="{name}"'
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f"<ssd:Connection{ends}{given}>{inside}</ssd:Connection>"


def system(name, elements, links, ports="", bindings="", after="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    links = links and f"<ssd:Connections>{links}</ssd:Connections>"
    return (
        f'<ssd:System name="{name}"{given}>{ports}{bindings}<ssd:Elements>{elements}</ssd:Elements>'
        f"{links}{after}</ssd:System>"
    )


def description(top, *, experiment=EXPERIMENT, units=UNITS, version="1.0"):
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription{NAMESPACES} name="corner"'
    return f'{text} version="{version}">{top}{units}{experiment}</ssd:SystemStructureDescription>'.encode()


def parameter(name, value, kind="Real", unit=""):
    given = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"{given}/></ssv:Parameter>'


def parameter_set(*parameters, units=""):
    return (
        f'<ssv:ParameterSet{NAMESPACES} version="1.0" name="set"><ssv:Parameters>{"".join(parameters)}'
        f"</ssv:Parameters>{units}</ssv:ParameterSet>"
    )


def binding(*parameters, mapping="", prefix="", source=""):
    inline = "" if source else f"<ssd:ParameterValues>{parameter_set(*parameters)}</ssd:ParameterValues>"
    given = (f' prefix="{prefix}"' if prefix else "") + (f' source="{source}"' if source else "")
    return f"<ssd:ParameterBinding{given}>{inline}{mapping}</ssd:ParameterBinding>"


def bindings(*each):
    return f"<ssd:ParameterBindings>{''.join(each)}</ssd:ParameterBindings>"


def entry(source, target, inside="", **attributes):
    given = "".join(f' {k}="{v}"' for k, v in attributes.items())
    return f'<ssm:MappingEntry source="{source}" target="{target}"{given}>{inside}</ssm:MappingEntry>'


def mapping(*entries):
    return f'<ssm:ParameterMapping{NAMESPACES} version="1.0">{"".join(entries)}</ssm:ParameterMapping>'
